"""A load that falls on the way, without digging or a boom that dumps: a part, or an exchange?"""

import numpy as np
import polars as pl
import pytest

from analysis.cycles.cycle_parts import split_cycles_into_parts
from analysis.cycles.load_passes import LoadPasses, find_load_passes

EMPTY_KG, U_KG, DRIVE_S = 12_000.0, 55.0, 25.0
NS = 10**9
NO_DIGGING = pl.DataFrame(schema={"start_t_ns": pl.Int64, "end_t_ns": pl.Int64})


def find_passes(*loads_kg: float, digging: pl.DataFrame = NO_DIGGING) -> LoadPasses:
    """Passes of drives with these loads in turn, a state each."""
    begin = np.arange(len(loads_kg)) * 35
    manoeuvres = pl.DataFrame(
        {
            "load_id": np.arange(len(loads_kg)),
            "mass_kg": EMPTY_KG + np.array(loads_kg),
            "mass_std_kg": np.full(len(loads_kg), U_KG),
            "start_t_ns": begin * NS,
            "end_t_ns": (begin + int(DRIVE_S)) * NS,
        }
    )
    found = find_load_passes(pl.DataFrame({"scatter_kg": [0.0]}), manoeuvres, digging)
    assert found is not None
    return found


@pytest.mark.parametrize(
    ("haul_kg", "falls"),
    [
        # the second dump of a body that keeps a third, then filled up again
        ((4800.0, 1600.0, 4400.0), True),
        # pallets exchanged at every stop
        ((3900.0, 2100.0, 4200.0, 1900.0), True),
        # a round that collects
        ((1500.0, 2600.0, 4700.0), False),
        # spillage, or one state split in two
        ((4800.0, 4000.0), False),
    ],
)
def test_a_pass_whose_load_falls_by_more_than_is_spilled_has_no_payload(
    haul_kg: tuple[float, ...], falls: bool
) -> None:
    whole = 0.0, 4500.0, 0.0, *haul_kg, 0.0, 4700.0, 0.0
    passes = find_passes(*whole)
    reasons = [cycle.missing_mass_reason for cycle in split_cycles_into_parts(passes, NO_DIGGING)]
    assert ["falls" in reason for reason in reasons] == [False, falls, False]


def test_where_the_machine_digs_every_dump_has_a_pass_of_its_own() -> None:
    digging = pl.DataFrame({"start_t_ns": [30 * NS], "end_t_ns": [33 * NS]})
    assert find_passes(0.0, 4800.0, 1600.0, 4400.0, 0.0, digging=digging).falling == ()
