"""A topic that begins minutes late or dies is followed as the causal replay has it: as a gap."""

from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from analysis.online.follower import FollowedRow
from analysis.simulation import Scenario
from replay import load_machine, open_log, run
from replay.follow.agreement import FollowedDigests
from replay.follow.follow_logs import FollowedLogState, follow_logs
from replay.simulation.simulate_logs import simulate_scenario_to_logs

CAUSAL = [
    "settings.filter.causal=true",
    "settings.noise.force_N=60.0",
    "settings.noise.acc_m_s2=0.01",
    "settings.noise.speed_m_s=0.005",
]
#: Longer than what may be missing at an end without being a gap, in s.
MISSING_S = 65.0


def write_without(source: Path, target: Path, topic: str, begin_s: float, end_s: float) -> None:
    """Copy an MCAP without the messages of a topic between two times, from its first message."""
    with source.open("rb") as read, target.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE)
        writer.start("ros2", "test")
        channels: dict[int, int] = {}
        first = None
        for schema, channel, message in make_reader(read).iter_messages():
            first = message.log_time if first is None else first
            if channel.topic == topic and begin_s <= (message.log_time - first) / 1e9 < end_s:
                continue
            if channel.id not in channels:
                assert schema is not None
                known = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, known
                )
            writer.add_message(
                channels[channel.id], message.log_time, message.data, message.publish_time
            )
        writer.finish()


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    plan = Scenario.model_validate({"campaign": {"loads_kg": [150], "runs": 10}})
    return simulate_scenario_to_logs(plan, tmp_path_factory.mktemp("whole") / "whole.mcap")[0]


@pytest.mark.parametrize("is_late", [True, False])
def test_a_topic_that_is_missing_at_an_end_is_followed_as_in_the_replay(
    whole: Path, tmp_path: Path, is_late: bool
) -> None:
    machine = load_machine("cat262c.toml", CAUSAL)
    topic = machine.channels["torque_left_N_m"].topic
    assert topic is not None
    with whole.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    length_ns = summary.statistics.message_end_time - summary.statistics.message_start_time
    length_s = length_ns / 1e9
    assert length_s > MISSING_S + 20.0
    part = tmp_path / "part.mcap"
    span = (0.0, MISSING_S) if is_late else (length_s - MISSING_S, length_s + 1.0)
    write_without(whole, part, topic, *span)
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
