"""Cycles without a mass: what digging and the boom show is counted, priced, or said."""

import numpy as np
import polars as pl
import pytest

from analysis.cycles.cycles_without_mass import (
    estimate_unweighed_load_and_u_kg,
    find_cycle_parts,
)
from analysis.cycles.load_passes import find_load_passes
from analysis.weighing.growing_load import LoadChangeInMotion
from recordings.report.shift_text import describe_shift_payload
from recordings.review.shift_facts import describe_missing_loads
from tests.analysis.cycles.drawn import NS, drawn_shift
from tests.analysis.cycles.test_cycles import found, summed

LOADS = [700.0, 650.0, 720.0, 690.0, 705.0, 660.0, 730.0, 680.0]


def unfinished(frames: dict[str, pl.DataFrame]) -> dict[str, pl.DataFrame]:
    """The same without the start that tells of the last empty drive."""
    return frames | {"manoeuvres": frames["manoeuvres"].head(-1)}


def cut(frames: dict[str, pl.DataFrame], until_s: float) -> dict[str, pl.DataFrame]:
    """The same up to a time."""
    kept = {n: frames[n].filter(pl.col("t_ns") < until_s * NS) for n in ("excitation", "aligned")}
    return unfinished(frames) | kept


def test_a_last_load_that_the_boom_dumps_is_counted() -> None:
    table = found(unfinished(drawn_shift(LOADS, boom=True)))
    assert table["counted"].all()
    assert table["payload_kg"].to_list() == pytest.approx(LOADS)
    assert table["dump_t_ns"][-1] == pytest.approx(783.5 * NS, abs=NS)


def test_a_load_that_is_on_board_at_the_end_is_said_and_not_in_the_tonnes_of_the_shift() -> None:
    row = summed(cut(drawn_shift(LOADS, boom=True), 776.0))
    assert row["cycles_counted"] == len(LOADS) - 1
    assert row["on_board_kg"] == pytest.approx(LOADS[-1])
    assert row["total_kg"] == pytest.approx(sum(LOADS[:-1]))
    assert describe_missing_loads(row)[0].startswith("On board when the recording ends: 0.680 ±")


@pytest.mark.parametrize(("until_s", "dumped"), [(782.0, False), (785.0, True)])
def test_a_bucket_that_is_not_half_empty_when_the_recording_ends_is_on_board(
    until_s: float, dumped: bool
) -> None:
    """The boom is out for five seconds at each dump: from 781 to 786 s at the last."""
    row = summed(cut(drawn_shift(LOADS, boom=True), until_s))
    assert row["cycles_counted"] == len(LOADS) - (not dumped)
    assert row["total_kg"] == pytest.approx(sum(LOADS if dumped else LOADS[:-1]))


def test_without_a_boom_a_last_load_may_have_been_dumped_and_u_holds_both() -> None:
    row = summed(unfinished(drawn_shift(LOADS)))
    assert row["uncounted_cycles"] == pytest.approx(0.5)
    for total in (sum(LOADS), sum(LOADS[:-1])):
        assert abs(row["total_kg"] - total) < 2.0 * row["total_u_kg"]


@pytest.mark.parametrize("digs", [True, False])
def test_two_dumps_between_two_weighable_empty_drives_are_two_cycles(digs: bool) -> None:
    table = found(drawn_shift(LOADS, boom=True, digs=digs, unseen_empty=(3,)))
    assert table["payload_kg"].to_list() == pytest.approx(LOADS)


def test_a_cycle_of_which_no_start_tells_the_load_is_dated_by_the_boom_and_priced_whole() -> None:
    frames = drawn_shift(LOADS, boom=True, unseen=(3,))
    table, row = found(frames), summed(frames)
    assert table["dump_t_ns"][3] == pytest.approx(383.5 * NS, abs=NS)
    assert (row["uncounted_cycles"], row["uncounted_cycles_u"]) == (1.0, 0.0)
    assert abs(row["total_kg"] - sum(LOADS)) < 2.0 * row["total_u_kg"]
    assert "in the shift" in describe_shift_payload(row)


def test_a_dump_of_the_boom_without_digging_is_worth_less_where_the_others_are_dug() -> None:
    whole = drawn_shift(LOADS, boom=True, unseen=(3,), unseen_digs=(3,))
    undug = drawn_shift(LOADS, boom=True, unseen=(3,), digs=False)
    assert summed(whole)["uncounted_cycles"] < summed(undug)["uncounted_cycles"] < 1.0


def test_a_boom_that_masses_confirm_at_every_dump_is_believed_where_there_is_no_mass() -> None:
    """Priced at 0.75 each as if independent, 48 of 320 were 3.6 u short."""
    unseen = tuple(range(2, 40, 5))
    row = summed(drawn_shift(LOADS * 5, boom=True, unseen=unseen, digs=False))
    assert row["cycles_without_mass"] == len(unseen)
    assert row["uncounted_cycles"] == pytest.approx(len(unseen), abs=0.3)
    assert row["total_kg"] == pytest.approx(5.0 * sum(LOADS), abs=2.0 * row["total_u_kg"])


def test_the_doubt_about_the_only_witness_is_common_to_all_that_it_shows() -> None:
    few, many = (
        summed(drawn_shift(LOADS, boom=True, unseen=unseen, digs=False))
        for unseen in ((3,), (1, 3, 4, 6))
    )
    assert many["uncounted_cycles_u"] > 2.5 * few["uncounted_cycles_u"]


def test_loads_that_are_dug_and_cannot_be_told_from_empty_are_said() -> None:
    frames = drawn_shift([20.0] * 8, noise_kg=60.0)
    row = summed(frames)
    assert (row["cycles_counted"], row["cycles_without_mass"]) == (0, 8)
    assert "cycles detected; no load has a mass" in describe_missing_loads(row)[0]


@pytest.mark.parametrize("boom", [True, False])
def test_short_cycles_are_all_counted(boom: bool) -> None:
    """Of 29 s, a third of whose empty drives no start tells."""
    frames = drawn_shift(LOADS * 3, boom=boom, pace=3.5, unseen_empty=tuple(range(1, 24, 3)))
    assert found(frames)["payload_kg"].to_list() == pytest.approx(LOADS * 3)


def test_loads_below_the_noise_of_a_start_are_told_by_what_is_dug() -> None:
    loads = np.random.default_rng(3).normal(140.0, 20.0, 30).tolist()
    frames = drawn_shift(loads, noise_kg=60.0, boom=True)
    row = summed(frames)
    assert row["cycles_counted"] == 30
    assert abs(row["total_kg"] - sum(loads)) < 2.5 * row["total_u_kg"]


def test_of_such_loads_those_that_are_not_seen_to_be_dug_are_told_by_their_mass() -> None:
    """Of three of 30, a mass is on the wrong side of the border once in thirty."""
    counted = 0
    for seed in range(10):
        loads = np.random.default_rng(seed).normal(140.0, 20.0, 30).tolist()
        frames = drawn_shift(loads, noise_kg=50.0, seed=seed, unseen_digs=(7, 12, 20), boom=True)
        counted += summed(frames)["cycles_counted"]
    assert counted >= 10 * 30 - 4


def test_one_load_that_is_weighed_is_no_price_for_all_others() -> None:
    few, many = (
        estimate_unweighed_load_and_u_kg(30.0, 0.0, 300.0, 60.0, counted) for counted in (2, 60)
    )
    assert few[0] == many[0] == 9000.0
    assert few[1] > 1000.0 > 2.0 * many[1]
    assert estimate_unweighed_load_and_u_kg(30.0, 0.0, 300.0, None, 1)[1] > 0.5 * 9000.0


def test_idle_hours_invent_nothing() -> None:
    idle, busy = (summed(drawn_shift(LOADS, boom=True, idle_s=s)) for s in (7200.0, 0.0))
    for name in ("cycles", "boom_dumps", "uncounted_cycles", "total_kg"):
        assert idle[name] == pytest.approx(busy[name])


def with_another_load(
    frames: dict[str, pl.DataFrame], starts: list[int], gains_kg: list[float]
) -> dict[str, pl.DataFrame]:
    """The same with other masses at these starts, each a load state of its own."""
    masses = frames["manoeuvres"]["mass_kg"].to_numpy().copy()
    masses[starts] += gains_kg
    states = np.cumsum(np.append(0, np.abs(np.diff(masses)) > 50.0))
    changed = frames["manoeuvres"].with_columns(
        mass_kg=pl.Series(masses), load_id=pl.Series(states)
    )
    return frames | {"manoeuvres": changed}


def list_first_loaded_starts(frames: dict[str, pl.DataFrame]) -> list[int]:
    """Of each cycle."""
    loaded = frames["manoeuvres"]["mass_kg"].to_numpy() > 4000.0
    return np.flatnonzero(loaded & np.append(True, ~loaded[:-1])).tolist()


@pytest.mark.parametrize("before_kg", [150.0, -150.0], ids=["spilled", "filled up"])
def test_what_is_dumped_is_the_last_load(before_kg: float) -> None:
    """Loads that were filled up on the way were averaged: 6.440 ± 0.130 t of 7.079."""
    frames = drawn_shift(LOADS)
    first = list_first_loaded_starts(frames)
    other = with_another_load(frames, first, [before_kg] * len(first))
    assert found(other)["payload_kg"].to_list() == pytest.approx(LOADS)


def test_a_load_that_is_dumped_in_two_parts_is_dumped_whole() -> None:
    """The second parts were carried back: 6.099 ± 0.225 t of 7.050."""
    frames = drawn_shift(LOADS, boom=True)
    cycles = [1, 4, 6]
    second = [list_first_loaded_starts(frames)[cycle] + 1 for cycle in cycles]
    seconds = frames["excitation"]["t_ns"] / NS
    between = seconds.is_between(0.0, -1.0)
    for cycle in cycles:
        between |= seconds.is_between(100.0 * cycle + 60.5, 100.0 * cycle + 64.5)
    halves = with_another_load(frames, second, [-LOADS[cycle] / 2.0 for cycle in cycles])
    halves["excitation"] = frames["excitation"].with_columns(
        phase=pl.when(between).then(pl.lit("standstill")).otherwise("phase")
    )
    halves["aligned"] = frames["aligned"].with_columns(
        boom_rad=pl.when(between).then(0.9).otherwise("boom_rad")
    )
    table = found(halves)
    assert table["payload_kg"].to_list() == pytest.approx(LOADS)
    assert table["carry_back_kg"].to_list() == pytest.approx([0.0] * len(LOADS))


def test_a_load_that_is_dumped_in_two_parts_without_a_boom_is_dumped_whole() -> None:
    """Every payload was that of the second part: 6.163 ± 0.166 t of 7.634."""
    frames = drawn_shift(LOADS)
    cycles = [1, 4, 6]
    second = [list_first_loaded_starts(frames)[cycle] + 1 for cycle in cycles]
    halves = with_another_load(frames, second, [-LOADS[cycle] / 2.0 for cycle in cycles])
    table = found(halves)
    assert table["payload_kg"].to_list() == pytest.approx(LOADS)
    assert table["carry_back_kg"].to_list() == pytest.approx([0.0] * len(LOADS))


def test_without_boom_and_digging_the_rhythm_shows_a_cycle_whose_load_no_start_tells() -> None:
    frames = drawn_shift(LOADS * 2, digs=False, unseen=(5,))
    row = summed(frames)
    assert row["cycles_counted"] == 15
    assert 0.6 < row["uncounted_cycles"] < 1.0
    assert abs(row["total_kg"] - 2.0 * sum(LOADS)) < 2.0 * row["total_u_kg"]


def test_a_machine_that_idles_between_two_dumps_is_not_out_of_rhythm() -> None:
    frames = drawn_shift(LOADS * 2, digs=False)
    late = pl.when(pl.col("t_ns") > 610 * NS).then(100 * NS).otherwise(0)
    begins = pl.col("start_t_ns") > 600 * NS
    later = [
        (pl.col(name) + pl.when(begins).then(100 * NS).otherwise(0)).alias(name)
        for name in ("start_t_ns", "end_t_ns")
    ]
    excitation = frames["excitation"].with_columns(t_ns=pl.col("t_ns") + late)
    stand = pl.DataFrame({"t_ns": np.arange(611 * NS, 710 * NS, NS // 10), "phase": "standstill"})
    excitation = pl.concat([excitation, stand]).sort("t_ns")
    aligned = pl.DataFrame({"t_ns": excitation["t_ns"], "gap": np.zeros(excitation.height, bool)})
    idle = {
        "excitation": excitation,
        "aligned": aligned,
        "manoeuvres": frames["manoeuvres"].with_columns(later),
    }
    assert summed(frames | idle)["uncounted_cycles"] == summed(frames)["uncounted_cycles"]


@pytest.mark.parametrize(
    ("mass_kg", "at_s", "cycles"),
    [
        (4300.0, (50.0, 65.0), len(LOADS)),  # its own mass is that of a load
        (3600.0, (50.0, 65.0), len(LOADS) - 1),  # it is that of the empty machine
        (4300.0, (5.0,), len(LOADS) - 1),  # an empty drive, too soon after the load before
    ],
)
@pytest.mark.parametrize("digs", [True, False])
def test_a_haul_that_is_excluded_from_the_fit_is_a_cycle_without_a_mass(
    digs: bool, mass_kg: float, at_s: tuple[float, ...], cycles: int
) -> None:
    frames = drawn_shift(LOADS, digs=False, unseen=(3,))
    frames["digging"] = drawn_shift(LOADS, digs=digs, unseen=(3,))["digging"]
    t_ns = frames["excitation"]["t_ns"].to_numpy()
    spans = np.searchsorted(t_ns, [((300.0 + at) * NS, (308.0 + at) * NS) for at in at_s])
    excluded = [
        LoadChangeInMotion(0, int(first), int(last), mass_kg, -2000.0, 300.0, is_possible=False)
        for first, last in spans
    ]
    passes = find_load_passes(frames["loads"], frames["manoeuvres"], frames["digging"])
    assert passes is not None
    parts, _ = find_cycle_parts(passes, frames, excluded, adds_boom=True)
    hauls = [part for part in parts if part.haul_ns]
    assert len(parts) == max(cycles, digs * len(LOADS))
    assert len(hauls) == cycles
    assert [part.missing_mass_reason for part in hauls if part.loaded_pass is None] == [
        "no usable start with this load"
    ] * (cycles - len(LOADS) + 1)


def test_a_first_haul_that_is_excluded_is_a_cycle_though_no_empty_drive_is_before_it() -> None:
    """Two machines that are filled while they creep lost a tenth of their tonnes."""
    frames = drawn_shift(LOADS, digs=False, unseen=(0,))
    frames["manoeuvres"] = frames["manoeuvres"].filter(pl.col("start_t_ns") > 100 * NS)
    t_ns = frames["excitation"]["t_ns"].to_numpy()
    first, last = (int(np.searchsorted(t_ns, s * NS)) for s in (50.0, 65.0))
    excluded = LoadChangeInMotion(0, first, last, 4300.0, 500.0, 80.0)
    passes = find_load_passes(frames["loads"], frames["manoeuvres"], frames["digging"])
    assert passes is not None
    parts, _ = find_cycle_parts(passes, frames, [excluded], adds_boom=True)
    assert len(parts) == len(LOADS)
    assert parts[0].haul_ns == (50 * NS, 65 * NS)


def test_two_excluded_hauls_with_no_weighed_drive_between_them_are_two_cycles() -> None:
    frames = drawn_shift(LOADS, digs=False, unseen=(0, 1))
    frames["manoeuvres"] = frames["manoeuvres"].filter(pl.col("start_t_ns") > 200 * NS)
    t_ns = frames["excitation"]["t_ns"].to_numpy()
    spans = np.searchsorted(t_ns, [(at * NS, (at + 8.0) * NS) for at in (50.0, 150.0)])
    excluded = [
        LoadChangeInMotion(0, int(first), int(last), 4300.0, 500.0, 80.0) for first, last in spans
    ]
    passes = find_load_passes(frames["loads"], frames["manoeuvres"], frames["digging"])
    assert passes is not None
    parts, _ = find_cycle_parts(passes, frames, excluded, adds_boom=True)
    assert [part.loaded_pass is None for part in parts] == [True] * 2 + [False] * (len(LOADS) - 2)


@pytest.mark.parametrize("starts_s", [(50.0,), (50.0, 55.0, 60.0), (50.0, 55.0, 60.0, 65.0)])
def test_every_second_haul_that_is_excluded_is_a_cycle(starts_s: tuple[float, ...]) -> None:
    """A crane had 5 of 10 loads and not a word of the others: its hauls were two cycles apart."""
    unseen = tuple(range(1, len(LOADS) - 1, 2))
    frames = drawn_shift(LOADS, digs=False, unseen=unseen)
    t_ns = frames["excitation"]["t_ns"].to_numpy()
    begins_s = [100.0 * haul + start for haul in unseen for start in starts_s]
    spans = np.searchsorted(t_ns, [(begin * NS, (begin + 4.0) * NS) for begin in begins_s])
    excluded = [
        LoadChangeInMotion(0, int(first), int(last), 4300.0, 500.0, 80.0) for first, last in spans
    ]
    passes = find_load_passes(frames["loads"], frames["manoeuvres"], frames["digging"])
    assert passes is not None
    parts, _ = find_cycle_parts(passes, frames, excluded, adds_boom=True)
    assert sum(part.loaded_pass is None for part in parts) == len(unseen)
    assert len(parts) == len(LOADS)
