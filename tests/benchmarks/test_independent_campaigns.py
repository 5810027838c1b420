"""The campaigns on the independent bench: one log and one short shift, kept and taken up again."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import pytest

import benchmarks.independent_shifts as shifts
import benchmarks.payloads as payloads
import benchmarks.scale_sources as scale_sources

LOG = ("clean", "9+9", 3)


def _no_more(*_: object) -> None:
    raise AssertionError("made again")


@pytest.mark.heavy
def test_a_campaign_of_payloads_goes_on_where_it_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept = tmp_path / "payloads.jsonl"
    (found,) = payloads.campaign([LOG], kept)
    assert found.open
    assert not found.one_state
    assert abs(found.deviation) < 4.0
    assert len(found.mass_deviations) == 2
    monkeypatch.setattr(payloads, "found_of", _no_more)
    assert list(payloads.campaign([LOG], kept)) == [found]
    with pytest.raises(AssertionError, match="made again"):
        list(payloads.campaign([LOG, ("clean", "9+9", 4)], kept))
    assert payloads.table([found]).count("\n") == 2
    assert "| 1.00 |" in payloads.ratios([found], payloads.read([kept]))


def _found(rows: Sequence[Mapping[str, object]], **truth: float) -> payloads.PayloadFound:
    whole = {"empty_kg": 3000.0, "payload_kg": 200.0, "payload_begin_kg": 200.0}
    whole |= {"empty_to_s": 60.0, "loaded_from_s": 80.0, **truth}
    common = {"mass_kg": 3200.0, "u_kg": 20.0, "withheld": False}
    loads = [{**common, **row} for row in rows]
    return payloads.PayloadFound("clean", "5+5", 0, "", whole, loads, [], 0.0)


def test_the_state_that_is_farthest_off_is_judged() -> None:
    empty = {"start_s": 2.0, "end_s": 60.0, "payload_kg": 0.0, "payload_u_kg": 0.0}
    near = {"start_s": 80.0, "end_s": 100.0, "payload_kg": 205.0, "payload_u_kg": 5.0}
    far = {"start_s": 101.0, "end_s": 150.0, "payload_kg": 185.0, "payload_u_kg": 5.0}
    assert _found([empty, near]).deviation == 1.0
    assert _found([empty, near, far]).deviation == -3.0
    assert not _found([empty, near, {**far, "withheld": True}]).open
    assert _found([{**near, "start_s": 2.0}]).one_state
    fills = _found([empty, near], payload_begin_kg=100.0)
    assert (fills.deviation, fills.outside) == (11.0, 1.0)


@pytest.mark.heavy
def test_a_campaign_of_shifts_goes_on_where_it_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept = tmp_path / "shifts.jsonl"
    (found,) = shifts.campaign([6], 0.1, kept)
    assert not found.refused
    assert not found.crashed
    assert found.true_t > 0.0
    monkeypatch.setattr(shifts, "reviewed", _no_more)
    (again,) = shifts.campaign([6], 0.1, kept)
    assert again.f1 == found.f1
    assert again.verdict([]) == found.verdict([])
    assert shifts.table([found], []).count("\n") == 2
    assert "F1 of all cycles" in shifts.totals([found], [])


def _shift(
    dumps_s: list[float], sum_kg: float, lost_kg: tuple[float, float] = (0.0, 0.0)
) -> shifts.IndependentShift:
    truth = {"dump_s": [100.0, 104.0, 300.0], "payload_kg": [500.0, 600.0, 700.0]}
    cycles = [
        {"dump_unix_ns": t * 1e9, "payload_kg": 520.0, "payload_u_kg": 10.0, "counted": True}
        for t in dumps_s
    ]
    summary = {"cycles_counted": len(cycles), "payload_kg": sum_kg, "payload_u_kg": 30.0}
    summary |= {"lost_kg": lost_kg[0], "lost_u_kg": lost_kg[1]}
    summary |= {"uncounted_kg": 0.0, "uncounted_u_kg": 0.0}
    return shifts.IndependentShift(0, truth, cycles, summary, ["not counted: 1 dump"], "", "", 0.0)


def test_a_dump_is_matched_once_with_the_nearest() -> None:
    found = _shift([101.0, 103.5, 200.0, 304.9], 1800.0)
    assert sorted(found.pairs) == [(0, 0), (1, 1), (3, 2)]
    assert found.f1 == pytest.approx(6.0 / 7.0)
    assert found.deviations[:2] == [2.0, -8.0]


def test_tonnes_are_within_u_with_what_is_priced_or_said_or_wrong() -> None:
    assert _shift([101.0], 1760.0).verdict([]) == "within U"
    assert _shift([101.0], 1200.0).verdict([]) == "wrong"
    assert _shift([101.0], 1200.0).verdict(["1 dump"]) == "said"
    assert _shift([101.0], 1200.0, (500.0, 100.0)).verdict([]) == "within U"
    assert _shift([], 0.0).verdict([]) == "withheld"
    assert replace(_shift([], 0.0), crashed="Traceback").verdict([]) == "crashed"


def test_tonnes_of_an_arm_are_those_of_the_cycles_that_are_true() -> None:
    parts = {"payload_u_random_kg": 3.0, "payload_u_shared_kg": 4.0, "payload_u_kg": 5.0}
    counted = {**parts, "counted": True, "payload_kg": 100.0}
    cycles = [
        {**counted, "dump_t_ns": 11_000_000_000},
        {**counted, "dump_t_ns": 41_000_000_000},
        {**counted, "dump_t_ns": 90_000_000_000},
        {**counted, "dump_t_ns": None},
        {**counted, "dump_t_ns": 70_000_000_000, "counted": False},
    ]
    shift = {"cycles_counted": 4, "total_kg": 400.0, "total_u_kg": 20.0}
    found = scale_sources.ScaledShift(
        *(1, 2.0, [90.0, 105.0, 80.0], [1010.0, 1040.0, 1070.0], [], ""),
        *({"ticket": shift}, {"ticket": cycles}, 1000.0, "", []),
    )
    said_kg, true_kg, u_kg, common_kg = found.matched("ticket")
    assert (said_kg, true_kg, common_kg) == (200.0, 195.0, 8.0)
    assert u_kg == pytest.approx((2 * 3.0**2 + 8.0**2) ** 0.5)
    (row,) = scale_sources.table([found]).splitlines()[2:]
    assert row.startswith("| ticket | 1 | 1 | 0 of 1 | 1 of 1 |")
