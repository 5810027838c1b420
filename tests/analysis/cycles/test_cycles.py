"""Cycles out of load states: payloads, carry-back, and what is said where there is no mass."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from analysis.cycles.cycles import weigh_cycles
from analysis.cycles.cycles_lost_in_gaps import (
    estimate_cycles_lost_in_gaps,
    find_spans_of_missing_channels_ns,
    mark_gaps_that_may_be_work_breaks,
)
from analysis.cycles.payload_target import compare_payloads_with_target
from analysis.cycles.shift_totals import (
    estimate_min_detectable_load_kg,
    make_shift_totals_frame,
    recompute_shift_totals,
)
from analysis.model.schema import FRAMES
from analysis.model.verdict import Verdict
from replay import load_machine
from tests.analysis.cycles.drawn import NS, drawn_shift
from tests.twins import mark_heavy_after

MACHINE = load_machine(Path("cat262c.toml"))
FINE = Verdict(())


def found(frames: dict[str, pl.DataFrame]) -> pl.DataFrame:
    return weigh_cycles(None, frames, MACHINE, FINE).cycles


def summed(frames: dict[str, pl.DataFrame]) -> dict[str, float]:
    return make_shift_totals_frame(found(frames), frames["excitation"], frames["aligned"]).row(
        0, named=True
    )


# thirty examples: each drives a shift of up to an hour
@pytest.mark.heavy
@settings(max_examples=30)
@given(st.lists(st.floats(200.0, 1100.0), min_size=2, max_size=30))
def test_what_is_dumped_is_the_payload_and_the_sum_is_that_of_the_shift(
    payloads: list[float],
) -> None:
    frames = drawn_shift(payloads)
    assert found(frames)["payload_kg"].to_list() == pytest.approx(payloads)
    assert summed(frames)["payload_kg"] == pytest.approx(sum(payloads))


@pytest.mark.heavy
@settings(max_examples=30)
@given(st.lists(st.floats(500.0, 1100.0), min_size=2, max_size=30))
def test_loads_that_are_alike_are_told_without_any_digging(payloads: list[float]) -> None:
    assert found(drawn_shift(payloads, digs=False))["payload_kg"].to_list() == pytest.approx(
        payloads
    )


def test_a_payload_is_what_was_dumped_not_what_was_loaded_where_some_is_carried_back() -> None:
    payloads, carried = [700.0, 650.0, 720.0, 690.0, 710.0], [40.0, 0.0, 60.0, 10.0, 0.0]
    table = found(drawn_shift(payloads, carried_kg=carried))
    assert table["payload_kg"].to_list() == pytest.approx(payloads, abs=3.0)
    assert table["carry_back_kg"].to_list() == pytest.approx(carried, abs=6.0)


def test_empty_passes_that_are_alike_count_by_half_each() -> None:
    table = found(drawn_shift([700.0] * 6))
    assert table["tare_before_1"].to_list() == pytest.approx([*[0.5] * 5, 2 / 3])


def test_times_are_told_and_follow_one_another() -> None:
    table = found(drawn_shift([700.0, 600.0, 800.0]))
    assert table["dump_t_ns"].to_list() == pytest.approx(
        [int(t * NS) for t in (83.5, 183.5, 283.5)], abs=NS
    )
    assert table["return_s"].to_list()[1:] == pytest.approx([50.0, 50.0], abs=1.0)
    assert table["load_s"].to_list() == pytest.approx([10.0] * 3)
    assert table["haul_s"].to_list() == pytest.approx([27.0] * 3, abs=1.0)


def test_a_cycle_whose_load_no_start_tells_is_listed_without_a_mass_and_with_the_reason() -> None:
    frames = drawn_shift([700.0, 650.0, 720.0, 690.0], unseen=(2,))
    table = found(frames)
    assert table.height == 4
    assert table["payload_kg"].is_null().to_list() == [False, False, True, False]
    assert table["withheld_for"][2] == "no usable start with this load"
    assert summed(frames)["cycles_without_mass"] == 1


def test_a_machine_that_digs_again_has_dumped_though_no_start_tells_of_the_empty_drive() -> None:
    payloads = [700.0, 650.0, 660.0, 690.0, 705.0]
    table = found(drawn_shift(payloads, unseen_empty=(2,)))
    assert table["payload_kg"].to_list() == pytest.approx(payloads)
    assert table["dump_t_ns"].to_list() == pytest.approx(
        [int((100.0 * k + 83.5) * NS) for k in range(5)], abs=NS
    )


def test_a_load_that_is_not_dumped_in_the_recording_is_not_counted() -> None:
    frames = drawn_shift([700.0, 650.0, 720.0])
    frames["manoeuvres"] = frames["manoeuvres"].head(-1)
    table = found(frames)
    assert table["quality"].to_list() == ["good", "good", "not dumped"]
    assert table["counted"].to_list() == [True, True, False]


def test_one_load_throughout_is_no_cycle() -> None:
    frames = drawn_shift([700.0], digs=False)
    frames["manoeuvres"] = frames["manoeuvres"].head(2)
    frames["loads"] = frames["loads"].head(1)
    assert found(frames).is_empty()
    assert summed(frames)["cycles"] == 0


@pytest.mark.heavy
@pytest.mark.parametrize("noise_kg", mark_heavy_after(1, [5.0, 30.0]))
def test_intervals_of_payloads_and_of_the_sum_hold_what_they_say(noise_kg: float) -> None:
    held: list[bool] = []
    sums: list[float] = []
    for seed in range(60):
        random = np.random.default_rng(seed)
        payloads = random.normal(700.0, 80.0, 12).clip(350.0).tolist()
        carried = random.exponential(10.0, 12).clip(0.0, 60.0).tolist()
        frames = drawn_shift(payloads, carried_kg=carried, noise_kg=noise_kg, seed=seed)
        table = found(frames)
        off = np.abs(table["payload_kg"].to_numpy() - payloads)
        held += (off < 2.0 * table["payload_u_kg"].to_numpy()).tolist()
        row = make_shift_totals_frame(table, frames["excitation"], frames["aligned"]).row(
            0, named=True
        )
        sums.append((row["payload_kg"] - sum(payloads)) / row["payload_u_kg"])
    assert 0.92 < np.mean(held) < 0.99
    assert 0.8 < np.sqrt(np.mean(np.square(sums))) < 1.25


def test_common_parts_do_not_average_out_and_random_ones_do() -> None:
    one, many = (found(drawn_shift([700.0] * n, noise_kg=5.0)) for n in (2, 32))
    sums = []
    for table in (one, many):
        common = table.with_columns(payload_u_shared_kg=pl.lit(7.0))
        columns = FRAMES["shift"].columns
        blank = pl.DataFrame({c.name: pl.Series([None], dtype=c.dtype) for c in columns})
        sums.append(recompute_shift_totals(blank, common).row(0, named=True))
    few, lots = sums
    assert lots["payload_u_common_kg"] == pytest.approx(16 * few["payload_u_common_kg"])
    assert lots["payload_u_random_kg"] < 6 * few["payload_u_random_kg"]


def test_a_rejected_cycle_is_not_in_the_sum() -> None:
    frames = drawn_shift([700.0, 600.0, 800.0])
    table = found(frames)
    whole = make_shift_totals_frame(table, frames["excitation"], frames["aligned"])
    row = recompute_shift_totals(whole, table, [2]).row(0, named=True)
    assert row["payload_kg"] == pytest.approx(1500.0)
    assert (row["cycles_counted"], row["cycles_rejected"]) == (2, 1)


def test_a_hole_of_some_cycles_is_priced_and_a_short_one_costs_nothing() -> None:
    frames = drawn_shift([700.0] * 20)
    table, aligned = found(frames), frames["aligned"]
    t_s = aligned["t_ns"].to_numpy() / NS
    for length, expected in ((10.0, 0.0), (427.0, 4.0)):
        gap = pl.Series("gap", (t_s > 500.0) & (t_s < 500.0 + length))
        gaps = find_spans_of_missing_channels_ns(frames["excitation"], aligned.with_columns(gap))
        lost = estimate_cycles_lost_in_gaps(table, gaps, [False] * len(gaps))
        assert lost.cycles == pytest.approx(expected, abs=0.02)
        assert lost.payload_kg == pytest.approx(700.0 * expected, abs=10.0)


@pytest.mark.parametrize("at_end", [False, True])
def test_readings_that_are_missing_at_an_end_of_the_log_are_a_span(at_end: bool) -> None:
    frames = drawn_shift([700.0] * 5)
    t_ns = frames["aligned"]["t_ns"].to_numpy()
    half_ns = int(t_ns[t_ns.size // 2])
    gap = pl.Series("gap", t_ns > half_ns if at_end else t_ns < half_ns)
    spans = find_spans_of_missing_channels_ns(
        frames["excitation"], frames["aligned"].with_columns(gap)
    )
    assert spans == [(half_ns, int(t_ns[-1])) if at_end else (int(t_ns[0]), half_ns)]


@pytest.mark.parametrize(("stands_s", "may_be"), [(100.0, True), (0.0, False)])
def test_what_is_missing_to_the_end_may_be_a_break_where_the_machine_stood(
    stands_s: float, may_be: bool
) -> None:
    t_s = np.arange(0.0, 1000.0)
    phase = np.where(t_s < 400.0 - stands_s, "accelerating", "standstill")
    excitation = pl.DataFrame(
        {"t_ns": (t_s * NS).astype(np.int64), "phase": np.where(t_s < 400.0, phase, None)},
        schema_overrides={"phase": pl.String},
    )
    span = (int(399 * NS), int(999 * NS))
    assert mark_gaps_that_may_be_work_breaks([span], excitation) == [may_be]


@pytest.mark.parametrize(("length_s", "stood"), [(427.0, True), (1200.0, False)])
def test_a_hole_that_may_be_a_break_hides_any_number_of_cycles(
    length_s: float, stood: bool
) -> None:
    table = found(drawn_shift([700.0] * 20))
    gap = [(0, int(length_s * NS))]
    worked = estimate_cycles_lost_in_gaps(table, [(0, int(427 * NS))], [False]).cycles
    most = worked + (length_s - 427.0) / float(np.mean(np.diff(table["dump_t_ns"]))) * NS
    lost = estimate_cycles_lost_in_gaps(table, gap, [stood])
    assert lost.cycles == pytest.approx(most / 2.0, rel=1e-3)
    # none and all of them are 1.7 standard uncertainties off
    assert lost.cycles - 1.8 * lost.u < 0.0 < lost.cycles - 1.6 * lost.u


def test_a_machine_that_stands_on_both_sides_of_a_hole_may_have_stood_all_the_while() -> None:
    rest, drives = "standstill", "accelerating"
    phases = [drives, rest, None, None, rest, drives, rest]
    excitation = pl.DataFrame({"t_ns": np.arange(7) * NS, "phase": phases})
    gaps = [(1 * NS, 3 * NS), (4 * NS, 5 * NS), (5 * NS, 6 * NS), (6 * NS, 9 * NS)]
    assert mark_gaps_that_may_be_work_breaks(gaps, excitation) == [False] * 4
    long = excitation.with_columns(t_ns=pl.Series([0, 1, 2, 3, 4, 5, 6]) * 40 * NS)
    gaps = [(40 * begin, 40 * end) for begin, end in gaps]
    # the last has no other side
    assert mark_gaps_that_may_be_work_breaks(gaps, long) == [True, False, False, True]


def test_many_breaks_are_all_work_or_none_alike() -> None:
    table = found(drawn_shift([700.0] * 20))
    one = estimate_cycles_lost_in_gaps(table, [(0, int(227 * NS))], [True])
    ten = estimate_cycles_lost_in_gaps(table, [(0, int(227 * NS))] * 10, [True] * 10)
    assert ten.cycles == pytest.approx(10.0 * one.cycles)
    assert ten.cycles - 1.8 * ten.u < 0.0


def test_a_night_between_two_logs_hides_no_cycle() -> None:
    table = found(drawn_shift([700.0] * 20))
    work, night = (0, int(227 * NS)), (0, int(15 * 3600 * NS))
    lost = estimate_cycles_lost_in_gaps(table, [work, night], [False, True])
    assert lost == estimate_cycles_lost_in_gaps(table, [work], [False])


def test_where_no_haul_was_seen_whole_a_hole_has_no_price_and_no_number_is_missing() -> None:
    frames = drawn_shift([700.0] * 6)
    unseen = found(frames).with_columns(haul_s=pl.lit(None, pl.Float64))
    gaps = [(0, int(427 * NS))]
    assert estimate_cycles_lost_in_gaps(unseen, gaps, [False]) == (0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("payloads", "keeps"),
    [([100.0] * 10, True), ([90.0] * 9 + [115.0], True), ([90.0] * 8 + [115.0] * 2, False),
     ([90.0] * 9 + [121.0], False), ([101.0] * 10, False)],
)  # fmt: skip
def test_a_tenth_may_be_above_110_percent_none_above_120_and_the_mean_at_the_target(
    payloads: list[float], keeps: bool
) -> None:
    table = pl.DataFrame({"payload_kg": payloads, "payload_u_kg": [0.1] * len(payloads)})
    judged = compare_payloads_with_target(table, 100.0)
    assert judged is not None
    assert judged.keeps is keeps


def test_the_smallest_detectable_load_is_told_from_none_in_nineteen_of_twenty_starts() -> None:
    noise_kg, scatter_kg = 300.0, 400.0
    manoeuvres = pl.DataFrame({"mass_std_kg": [noise_kg] * 5})
    least_kg = estimate_min_detectable_load_kg(
        manoeuvres, pl.DataFrame({"scatter_kg": scatter_kg, "scatter_known": True})
    )
    assert least_kg is not None
    one_start_kg = np.hypot(noise_kg, scatter_kg) * np.random.default_rng(8).normal(size=100_000)
    limit_kg = least_kg / 2.0
    assert np.mean(one_start_kg > limit_kg) == pytest.approx(0.05, abs=0.003)
    assert np.mean(least_kg + one_start_kg < limit_kg) == pytest.approx(0.05, abs=0.003)


def test_without_masses_no_load_is_the_smallest_that_shows() -> None:
    nothing = pl.DataFrame({"mass_std_kg": [None]}, {"mass_std_kg": pl.Float64})
    loads = pl.DataFrame({"scatter_kg": 0.0, "scatter_known": True})
    assert estimate_min_detectable_load_kg(nothing, loads) is None
    some = pl.DataFrame({"mass_std_kg": [300.0]})
    unknown = loads.with_columns(scatter_known=False)
    assert estimate_min_detectable_load_kg(some, unknown) is None
