"""Manoeuvres that would haul a load in next to no time: without digging nothing filled it."""

import numpy as np
import polars as pl
import pytest

from analysis.cycles.load_passes import LoadPasses, find_load_passes

EMPTY_KG, LOAD_KG, U_KG = 4500.0, 1100.0, 60.0
HAUL_S, BACK_OUT_S = 30.0, 6.0
CYCLES = 8
NS = 10**9


def passes_of_shift(
    heavy_back_outs: tuple[int, ...],
    dug_before: tuple[int, ...] = (),
    back_out_s: float = BACK_OUT_S,
    weighed_in_part: tuple[int, ...] = (),
) -> LoadPasses:
    """A shift that hauls, backs out of the dump and goes back empty, some back-outs too heavy.

    Args:
        heavy_back_outs: cycles in which backing out has the mass of a load and more.
        dug_before: those of them that dug before they backed out.
        back_out_s: how long it backs out.
        weighed_in_part: hauls of which only a short first manoeuvre is weighed.
    """
    rows: list[tuple[float, float, bool]] = []
    digs: list[tuple[float, float]] = []
    t_s = 0.0
    for cycle in range(CYCLES):
        rows.append((t_s, t_s + (6.0 if cycle in weighed_in_part else HAUL_S), True))
        t_s += HAUL_S + 5.0
        # a short empty manoeuvre between the dump and what is too heavy
        rows.append((t_s, t_s + 3.0, False))
        t_s += 5.0
        if cycle in dug_before:
            digs.append((t_s - 1.5, t_s - 0.5))
        rows.append((t_s, t_s + back_out_s, cycle in heavy_back_outs))
        t_s += back_out_s + 5.0
        rows.append((t_s, t_s + HAUL_S, False))
        t_s += HAUL_S + 5.0
    begin, end, loaded = (np.array(column) for column in zip(*rows, strict=True))
    mass_kg = EMPTY_KG + LOAD_KG * loaded + np.random.default_rng(1).normal(0.0, U_KG, loaded.size)
    manoeuvres = pl.DataFrame(
        {
            "load_id": np.append(0, np.cumsum(np.diff(loaded) != 0)),
            "mass_kg": mass_kg,
            "mass_std_kg": np.full(loaded.size, U_KG),
            "start_t_ns": (begin * NS).astype(np.int64),
            "end_t_ns": (end * NS).astype(np.int64),
        }
    )
    dug = [[int(second * NS) for second in column] for column in zip(*digs, strict=True)] or [
        [],
        [],
    ]
    digging = pl.DataFrame(
        dict(zip(("start_t_ns", "end_t_ns"), dug, strict=True)),
        schema={"start_t_ns": pl.Int64, "end_t_ns": pl.Int64},
    )
    found = find_load_passes(pl.DataFrame({"scatter_kg": [0.0]}), manoeuvres, digging)
    assert found is not None
    return found


def test_backing_out_that_is_too_heavy_is_no_load() -> None:
    found = passes_of_shift(heavy_back_outs=(2, 5))
    assert int(found.loaded.sum()) == CYCLES
    assert found.loaded.tolist() == [True, False] * CYCLES


def test_nor_is_its_mass_part_of_the_empty_pass() -> None:
    found = passes_of_shift(heavy_back_outs=(2, 5))
    assert found.mass_kg[~found.loaded] == pytest.approx(EMPTY_KG, abs=3.0 * U_KG)


def test_a_short_haul_of_what_was_dug_is_a_load() -> None:
    assert int(passes_of_shift((2, 5), dug_before=(2,)).loaded.sum()) == CYCLES + 1


def test_a_haul_of_usual_length_is_a_load() -> None:
    assert int(passes_of_shift((2, 5), back_out_s=0.6 * HAUL_S).loaded.sum()) == CYCLES + 2


def test_a_haul_of_which_a_part_is_weighed_is_a_load() -> None:
    assert int(passes_of_shift((2, 5), weighed_in_part=(1, 4)).loaded.sum()) == CYCLES
