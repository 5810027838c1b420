"""A topic that begins minutes late or dies is followed as the causal replay has it: as a gap."""

from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType

from analysis.online.follower import FollowedRow
from analysis.simulation import Scenario
from replay import load_machine, open_log, run
from replay.follow.agreement import FollowedDigests
from replay.follow.follow_logs import FollowedLogState, follow_logs
from replay.simulation.simulate_logs import simulate_scenario_to_logs
from tests.replay.follow.recorders import mcap_recorder
from tests.twins import mark_heavy_after

CAUSAL = [
    "settings.filter.causal=true",
    "settings.noise.force_N=60.0",
    "settings.noise.acc_m_s2=0.01",
    "settings.noise.speed_m_s=0.005",
]
#: Longer than what may be missing at an end without being a gap, in s.
MISSING_S = 65.0


@pytest.fixture(scope="module")
def complete_log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    plan = Scenario.model_validate({"campaign": {"loads_kg": [150], "runs": 10}})
    return simulate_scenario_to_logs(plan, tmp_path_factory.mktemp("whole") / "whole.mcap")[0]


@pytest.mark.heavy
@pytest.mark.parametrize("is_late", mark_heavy_after(1, [True, False]))
def test_a_topic_that_is_missing_at_an_end_is_followed_as_in_the_replay(
    complete_log: Path, tmp_path: Path, is_late: bool
) -> None:
    machine = load_machine("cat262c.toml", CAUSAL)
    topic = machine.channels["torque_left_N_m"].topic
    assert topic is not None
    with complete_log.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    length_ns = summary.statistics.message_end_time - summary.statistics.message_start_time
    length_s = length_ns / 1e9
    assert length_s > MISSING_S + 20.0
    part = tmp_path / "part.mcap"
    span = (0.0, MISSING_S) if is_late else (length_s - MISSING_S, length_s + 1.0)
    start_ns = summary.statistics.message_start_time

    def is_kept(of: str, log_time_ns: int) -> bool:
        return of != topic or not span[0] <= (log_time_ns - start_ns) / 1e9 < span[1]

    for _ in mcap_recorder(complete_log, part, CompressionType.NONE, is_kept=is_kept):
        pass
    digests, rows = FollowedDigests(), list[FollowedRow]()

    def take(_: FollowedLogState, new: list[FollowedRow]) -> None:
        digests.add_followed_rows(new)
        rows.extend(row for row in new if row.gate is not None)

    follow_logs([part], machine, take, idle_s=0.1)
    with open_log(part) as log:
        replay = run(log, machine)
    assert any("no readings of torque_left_N_m" in note for note in replay.provenance.notes)
    assert rows[-1].t_ns == replay.frames["excitation"]["t_ns"][-1] > 0.9e9 * length_s
    agreements = digests.compare_with_replayed_frames(replay.frames)
    assert {each.name for each in agreements} >= {"gate", "pooled"}
    assert all(each.is_rounding and each.rows == each.replayed for each in agreements)
