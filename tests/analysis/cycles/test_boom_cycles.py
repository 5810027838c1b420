"""Cycles that boom or digging show where masses tell none, or others."""

import numpy as np
import polars as pl
import pytest

from analysis.cycles.boom_dumps import group_boom_out_times_into_dumps
from tests.analysis.cycles.drawn import NS, PERIOD_S, drawn_shift
from tests.analysis.cycles.test_cycles import found

LOADS = [700.0, 650.0, 720.0, 690.0, 705.0, 660.0]
#: The boom is out from 81 to 86 s of each cycle.
OUT_S = (81.0, 86.0)


def of_one_mass(**options: bool) -> dict[str, pl.DataFrame]:
    """A shift whose masses are all alike: no start tells a load."""
    return drawn_shift([0.0] * len(LOADS), **options)


@pytest.mark.parametrize("digs", [True, False])
def test_the_boom_alone_shows_every_cycle_without_a_mass(digs: bool) -> None:
    table = found(of_one_mass(boom=True, digs=digs))
    assert table.height == len(LOADS)
    assert table["payload_kg"].null_count() == len(LOADS)
    assert not table["counted"].any()
    for number, dump_ns in enumerate(table["dump_t_ns"]):
        begin_s, end_s = (number * PERIOD_S + out_s for out_s in OUT_S)
        assert begin_s * NS <= dump_ns <= end_s * NS
    assert table["dig_t_ns"].null_count() == (0 if digs else len(LOADS))


def test_a_boom_dumps_where_it_is_up_although_it_goes_down_farther() -> None:
    """Moved while it drives, it is halfway up most of the time; down it waits for a while."""
    frames = of_one_mass(boom=True, digs=False)
    seconds = pl.col("t_ns") / NS % PERIOD_S
    angle = pl.when(seconds.is_between(*OUT_S)).then(0.95).when(seconds.is_between(87.0, 90.0))
    boom_rad = angle.then(-0.4).otherwise(0.45)
    table = found(frames | {"aligned": frames["aligned"].with_columns(boom_rad=boom_rad)})
    begin_s = [number * PERIOD_S + OUT_S[0] for number in range(len(LOADS))]
    assert table["dump_t_ns"].to_list() == pytest.approx([s * NS for s in begin_s], abs=5 * NS)


def test_a_boom_that_begins_to_rise_on_the_way_dumps_where_the_machine_arrives() -> None:
    frames = of_one_mass(boom=True, digs=False)
    seconds = pl.col("t_ns") / NS % PERIOD_S
    rises = seconds.is_between(60.0, 62.0)
    angle = pl.when(rises).then(0.6).when(seconds.is_between(62.0, OUT_S[1])).then(0.9)
    phase = pl.when(rises).then(pl.lit("standstill")).otherwise("phase")
    excitation = frames["excitation"].with_columns(phase=phase)
    aligned = frames["aligned"].with_columns(boom_rad=angle.otherwise(0.2))
    table = found(frames | {"aligned": aligned, "excitation": excitation})
    arrives_s = [number * PERIOD_S + 77.0 for number in range(len(LOADS))]
    assert table["dump_t_ns"].to_list() == pytest.approx([s * NS for s in arrives_s], abs=5 * NS)


def test_digging_alone_shows_every_cycle_and_the_longest_stand_between_two_the_dump() -> None:
    table = found(of_one_mass())
    assert table.height == len(LOADS)
    *dumped, last = table["dump_t_ns"]
    assert last is None
    for number, dump_ns in enumerate(dumped):
        assert 77.0 <= dump_ns / NS - number * PERIOD_S <= 90.0


def test_nothing_shows_no_cycle() -> None:
    assert found(of_one_mass(digs=False)).height == 0


def test_a_boom_that_dumps_elsewhere_than_the_masses_withholds_them() -> None:
    frames = drawn_shift(LOADS, boom=True)
    masses = frames["manoeuvres"]
    # as if every load were dumped before it is hauled
    moved = masses.with_columns(
        mass_kg=pl.col("mass_kg").shift(-2, fill_value=3600.0),
        load_id=pl.col("load_id").shift(-2, fill_value=int(masses["load_id"][-1])),
    ).with_columns(pl.col("load_id") - pl.col("load_id").min())
    loads = frames["loads"].head(moved["load_id"].n_unique())
    table = found(frames | {"manoeuvres": moved, "loads": loads})
    assert table.height == len(LOADS)
    assert not table["counted"].any()
    assert "boom" in table["withheld_for"][0]


@pytest.mark.parametrize("count", [2, 3])
def test_a_last_dump_after_which_nothing_is_weighed_contradicts_no_mass(count: int) -> None:
    frames = drawn_shift(LOADS[:count], boom=True)
    masses = frames["manoeuvres"].head(-1)
    loads = frames["loads"].head(masses["load_id"].n_unique())
    table = found(frames | {"manoeuvres": masses, "loads": loads})
    assert table["payload_kg"].to_list()[:-1] == pytest.approx(LOADS[: count - 1])
    assert table["counted"].to_list()[:-1] == [True] * (count - 1)
    assert table["withheld_for"][-1] == "the recording ends before the dump"


def masses_that_follow_the_direction() -> dict[str, pl.DataFrame]:
    """Every other start is loaded by its mass, though the bucket is filled in every fourth."""
    frames = drawn_shift([700.0] * 8)
    starts = frames["manoeuvres"].with_row_index("load_id_")
    masses = starts.with_columns(
        mass_kg=3600.0 + 700.0 * (1 - pl.col("load_id_") % 2), load_id=pl.col("load_id_").cast(int)
    ).drop("load_id_")
    loads = pl.concat([frames["loads"].head(1)] * masses.height)
    return frames | {"manoeuvres": masses, "loads": loads}


def test_masses_that_haul_every_bucket_twice_are_withheld_and_digging_shows_the_cycles() -> None:
    table = found(masses_that_follow_the_direction())
    assert table.height == 8
    assert not table["counted"].any()
    assert "more than one haul" in table["withheld_for"][0]


def test_buckets_whose_digging_is_missed_leave_the_masses_alone() -> None:
    table = found(drawn_shift([700.0] * 12, unseen_digs=(1, 3, 4, 7, 9, 10)))
    assert table.height == 12
    assert table["counted"].all()


def test_a_start_that_creeps_while_it_dumps_has_no_part_in_the_load() -> None:
    frames = drawn_shift(LOADS, boom=True)
    masses = frames["manoeuvres"]
    # half of the load is out in a start from 80 to 88 s, with its boom up from 81 to 86 s
    loads = pl.col("mass_kg") > 3900.0
    is_creeping = masses.filter(loads).gather_every(2, 1)
    start_ns = is_creeping["start_t_ns"] // int(PERIOD_S * NS) * int(PERIOD_S * NS)
    is_creeping = is_creeping.with_columns(
        start_t_ns=start_ns + 80 * NS,
        end_t_ns=start_ns + 88 * NS,
        mass_kg=3600.0 + (pl.col("mass_kg") - 3600.0) / 2.0,
    )
    table = found(frames | {"manoeuvres": pl.concat([masses, is_creeping]).sort("start_t_ns")})
    assert table["payload_kg"].to_list() == pytest.approx(LOADS)


@pytest.mark.parametrize(("drives_ns", "dumps"), [([], 1), ([9 * NS], 2)])
def test_a_boom_that_is_out_again_soon_has_dumped_twice_only_if_the_machine_drove(
    drives_ns: list[int], dumps: int
) -> None:
    """Out until 6 s and again from 12 s; in between it is retracted: the bucket is shaken."""
    out_ns = np.array([4, 5, 6, 12, 13]) * NS
    spans = group_boom_out_times_into_dumps(
        out_ns, np.arange(7, 12) * NS, np.array(drives_ns, np.int64)
    )
    assert len(spans) == dumps
