"""Logs of a simulator that shares nothing with the fit: what each was once wrong by."""

from pathlib import Path

import pytest

from analysis.model.run_record import Run
from benchmarks.independent.shift_logs import ShiftLog, ShiftPlan, shift_log, write_shift_log
from benchmarks.payloads import found_of
from replay import load_machine, open_log
from replay.pipeline import run


@pytest.mark.heavy
@pytest.mark.parametrize(
    ("situation", "seed"),
    [
        # the accelerometer sees the body swing on its springs: 2.2 u by means of 0.05 s
        pytest.param("squat 0.3", 98014, marks=pytest.mark.slow),
        # friction that falls fast and then levels off: 3.8 u by a parabola
        ("warming 25", 98007),
    ],
)
def test_the_payload_of_five_starts_holds(situation: str, seed: int) -> None:
    found = found_of(situation, "5+5", seed)
    assert found.open
    assert not found.one_state
    assert abs(found.deviation) < 2.0


def replay_shift(log: ShiftLog, folder: Path) -> Run:
    paths, machine = write_shift_log(log, folder)
    return run([open_log(path) for path in paths], load_machine(machine))


@pytest.mark.heavy
@pytest.mark.parametrize(
    ("seed", "share", "habits"),
    [
        # each load is tipped out over a metre or two: a third of the tonnes, 11 U off
        pytest.param(95013, 0.4, {"creeps to dump"}, marks=pytest.mark.slow),
        # an edge between two grounds hid every load where only turning tells of them
        (95025, 0.3, {"no boom", "no digging", "reverses out"}),
        # half of the loads are taken on the near side of an edge of the ground: 3 U off
        pytest.param(114010, 0.4, {"no digging", "short cycles"}, marks=pytest.mark.slow),
        # a fit of one load fits no edge, and its masses scatter by more than the loads: no cycle
        pytest.param(
            *(118049, 0.4, {"no boom", "no digging", "reverses out"}), marks=pytest.mark.slow
        ),
        # starts that miss an edge "lost" five times the load: 18 cycles of 23
        pytest.param(
            *(118049, 0.6, {"no boom", "no digging", "reverses out"}), marks=pytest.mark.slow
        ),
    ],
)
def test_the_tonnes_of_a_shift_hold(
    seed: int, share: float, habits: set[str], tmp_path: Path
) -> None:
    log = shift_log(seed, ShiftPlan(shorter=share))
    assert habits <= set(log.truth.habits)
    (shift,) = replay_shift(log, tmp_path).frames["shift"].to_dicts()
    # some loads of 114010 have no mass; they are priced beside those that are counted
    assert shift["cycles_counted"] >= 0.85 * len(log.truth.dump_s)
    error_kg = shift["total_kg"] - 1e3 * log.truth.tonnes
    assert abs(error_kg) < 2.0 * shift["total_u_kg"]
