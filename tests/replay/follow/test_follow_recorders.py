"""A log that is followed while others record it gives what the replay of the finished log gives."""

from collections.abc import Callable, Iterator
from contextlib import closing
from functools import partial
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from mcap.writer import CompressionType

from analysis.model.machine import Channel, LogSection, Machine
from analysis.model.run_record import Run
from analysis.online.follower import FollowedRow
from analysis.simulation import Scenario
from replay import load_machine, open_log, run
from replay.follow.agreement import FollowedDigests
from replay.follow.follow_logs import FollowedLogState, follow_logs
from replay.inputs.channel_inputs import list_channel_fields
from replay.logs import open_growing_log
from replay.machines.machine_file import find_time_axis_of_machine
from replay.simulation.simulate_logs import simulate_scenario_to_logs
from tests.replay.follow.recorders import (
    Recording,
    bag_recorder,
    csv_recorder,
    mcap_recorder,
    rosbag2_recorder,
)
from tests.twins import mark_slow_after

REPO = Path(__file__).resolve().parents[3]
#: Two starts of the paper's loader.
TWO_STARTS = Scenario.model_validate({"campaign": {"loads_kg": [150], "runs": 2}})
#: One, for what each recorder writes.
ONE_START = Scenario.model_validate({"campaign": {"loads_kg": [150], "runs": 1}})
CAUSAL = [
    "settings.filter.causal=true",
    "settings.noise.force_N=60.0",
    "settings.noise.acc_m_s2=0.01",
    "settings.noise.speed_m_s=0.005",
]
#: A log that nobody writes any more has ended after so long.
IDLE_S = 0.5
#: One that a recorder writes ends when it says so, however busy the processor is.
PATIENT_S = 300.0
#: By name: the suffix of the log that is written again, and the recorder that does it.
FORMATS: dict[str, tuple[str, Callable[[Path, Path], Iterator[None]]]] = {
    "bag": (".bag", bag_recorder),
    "bag with lz4": (".bag", partial(bag_recorder, compression="lz4")),
    "MCAP with zstd": (".mcap", partial(mcap_recorder, compression=CompressionType.ZSTD)),
    "MCAP with lz4": (".mcap", partial(mcap_recorder, compression=CompressionType.LZ4)),
    "MCAP without chunks": (
        ".mcap",
        partial(mcap_recorder, compression=CompressionType.NONE, chunks=False),
    ),
    "rosbag2 in WAL mode": (".db3", rosbag2_recorder),
    "rosbag2 that rotates": (".db3", partial(rosbag2_recorder, rows_a_file=700)),
    "CSV": (".csv", csv_recorder),
}
#: They pack what others here have in another way.
PACKED_OTHERWISE = ("bag", "MCAP with lz4")
CONTAINERS = [name for name in FORMATS if name not in PACKED_OTHERWISE]


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The same drive in every format."""
    return written(TWO_STARTS, tmp_path_factory.mktemp("followed"))


@pytest.fixture(scope="module")
def short_logs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Half of it."""
    return written(ONE_START, tmp_path_factory.mktemp("short"))


def written(drive: Scenario, folder: Path) -> dict[str, Path]:
    suffixes = dict.fromkeys(suffix for suffix, _ in FORMATS.values())
    return {
        suffix: simulate_scenario_to_logs(drive, folder / f"drive{suffix}")[0]
        for suffix in suffixes
    }


def machine_of(log: Path) -> Machine:
    machine = load_machine("cat262c.toml", CAUSAL)
    if log.suffix != ".csv":
        return machine
    # a simulated table has a column a channel
    channels = {
        name: channel if channel.derive else Channel(field=name)
        for name, channel in machine.channels.items()
    }
    return machine.model_copy(update={"channels": channels, "log": LogSection(time="time_s")})


def followed(
    path: Path, machine: Machine, recording: Recording
) -> tuple[FollowedLogState, list[FollowedRow]]:
    """Follow until the log says that it ends or, where it cannot, nothing comes any more."""
    rows: list[FollowedRow] = []
    looks_after_the_end = 0

    def take(_: FollowedLogState, new: list[FollowedRow]) -> None:
        nonlocal looks_after_the_end
        rows.extend(new)
        looks_after_the_end = 0 if new else looks_after_the_end + recording.is_over
        # the first may have begun before the end, and a log that says so has ended by now
        if looks_after_the_end == 3:
            raise KeyboardInterrupt

    return follow_logs([path], machine, take, idle_s=PATIENT_S), rows


def replayed(path: Path, machine: Machine) -> Run:
    with open_log(path, time=find_time_axis_of_machine(machine)) as log:
        return run(log, machine)


def assert_as_replayed(rows: list[FollowedRow], replay: Run) -> None:
    stepped = [(row.t_ns, row.gate) for row in rows if row.gate is not None]
    gate = replay.frames["gate"]
    assert [t_ns for t_ns, _ in stepped] == gate["t_ns"].to_list()
    assert [seen.reason for _, seen in stepped] == gate["reason_x"].to_list()
    for name in ("corr_x_1", "mi_x_nat", "predicted_std_x", "noise_share_x_1"):
        numbers = np.array([seen.make_gate_columns()[name] for _, seen in stepped])
        np.testing.assert_array_equal(numbers, gate[name].fill_null(np.nan).to_numpy())
    methods = [name for name in replay.frames if name.startswith("estimates/")]
    assert methods
    for name in methods:
        frame = replay.frames[name]
        mine = [
            (t_ns, *estimate.theta)
            for row in rows
            for method, (t_ns, estimate) in row.estimates.items()
            if f"estimates/{method}" == name
        ]
        theirs = frame.select("t_ns", "mass_kg", "friction_x_N_s_m").rows()
        assert mine == theirs, name


@pytest.mark.heavy
@pytest.mark.parametrize(
    "recorder", mark_slow_after(len(CONTAINERS), [*CONTAINERS, *PACKED_OTHERWISE])
)
def test_what_is_followed_is_what_the_replay_has_bit_for_bit(
    recorder: str, short_logs: dict[str, Path], tmp_path: Path
) -> None:
    suffix, record = FORMATS[recorder]
    machine = machine_of(short_logs[suffix])
    target = tmp_path / ("growing" if suffix == ".db3" else f"growing{suffix}")
    with Recording(record(short_logs[suffix], target), target) as recording:
        following, rows = followed(target, machine, recording)
    assert_as_replayed(rows, replayed(target, machine))
    assert following.follower.manoeuvres == 1
    assert not following.losses
    assert following.follower.log.late_samples == 0


@pytest.mark.heavy
def test_an_active_bag_is_followed_over_its_renaming(logs: dict[str, Path], tmp_path: Path) -> None:
    target, active = tmp_path / "drive.bag", tmp_path / "drive.bag.active"

    def record():
        yield from bag_recorder(logs[".bag"], active)
        active.rename(target)

    with Recording(record(), active) as recording:
        following, rows = followed(active, machine_of(target), recording)
    assert following.end_reason == "the recorder has closed the log"
    assert_as_replayed(rows, replayed(target, machine_of(target)))


@pytest.mark.parametrize("suffix", [".bag", ".mcap"])
def test_a_chunk_is_read_when_its_last_byte_is_there(
    suffix: str, logs: dict[str, Path], tmp_path: Path
) -> None:
    """Cut anywhere, a log gives whole messages and none twice; what follows completes them."""
    data = logs[suffix].read_bytes()
    target = tmp_path / f"torn{suffix}"
    fields = list_channel_fields(machine_of(target))
    parts: dict[str, list[pl.DataFrame]] = {}
    cuts = np.sort(np.random.default_rng(1).integers(1, len(data), 40))
    target.write_bytes(b"")
    with closing(open_growing_log([target], fields)) as tail:
        for begin, end in zip([0, *cuts], [*cuts, len(data)], strict=True):
            with target.open("ab") as file:
                file.write(data[begin:end])
            for topic, frame in tail.poll().items():
                parts.setdefault(topic, []).append(frame)
        assert tail.poll() == {}
        assert tail.is_finished
    with open_log(logs[suffix]) as whole:
        for topic, names in fields.items():
            assert pl.concat(parts[topic]).equals(whole.read(topic, names))


@pytest.mark.heavy
def test_a_log_whose_recorder_was_killed_is_given_up_to_its_last_whole_chunk(
    logs: dict[str, Path], tmp_path: Path
) -> None:
    machine = machine_of(logs[".mcap"])
    target = tmp_path / "killed.mcap"
    target.write_bytes(logs[".mcap"].read_bytes()[:-200_000])
    rows: list[FollowedRow] = []
    following = follow_logs([target], machine, lambda _, new: rows.extend(new), idle_s=IDLE_S)
    assert following.end_reason == f"the log has not grown for {IDLE_S:g} s"
    whole = replayed(logs[".mcap"], machine).frames["gate"]["reason_x"].to_list()
    reasons = [row.gate.reason for row in rows if row.gate is not None]
    assert 500 < len(reasons) < len(whole)
    assert reasons == whole[: len(reasons)]


@pytest.mark.heavy
def test_digests_say_from_which_minute_on_a_replay_differs(logs: dict[str, Path]) -> None:
    machine = machine_of(logs[".bag"])
    digests = FollowedDigests()
    follow_logs(
        [logs[".bag"]], machine, lambda _, rows: digests.add_followed_rows(rows), idle_s=IDLE_S
    )
    frames = dict(replayed(logs[".bag"], machine).frames)
    assert all(each.differs_from_s is None for each in digests.compare_with_replayed_frames(frames))
    frames["estimates/ls"] = frames["estimates/ls"].with_columns(pl.col("mass_kg") + 1e-9)
    frames["estimates/tls"] = frames["estimates/tls"].with_columns(pl.col("mass_kg") + 1.0)
    compared = {each.name: each for each in digests.compare_with_replayed_frames(frames)}
    differing = [name for name, each in compared.items() if each.differs_from_s is not None]
    assert differing == ["ls", "tls"]
    assert compared["ls"].is_rounding
    assert not compared["tls"].is_rounding


@pytest.mark.heavy
def test_holes_of_a_log_are_as_in_the_replay(logs: dict[str, Path], tmp_path: Path) -> None:
    """A drop-out, and a pause of which the grid keeps the ends alone."""
    source, target = tmp_path / "holes.csv", tmp_path / "growing.csv"
    table = pl.read_csv(logs[".csv"], infer_schema_length=None)
    time_s = pl.col("time_s")
    table = table.filter(~time_s.is_between(14.0, 14.3)).with_columns(
        time_s=pl.when(time_s > 17.0).then(time_s + 130.0).otherwise(time_s)
    )
    table.write_csv(source)
    machine = machine_of(source)
    with Recording(csv_recorder(source, target), target) as recording:
        _, rows = followed(target, machine, recording)
    assert_as_replayed(rows, replayed(target, machine))
    assert {row.gate.reason for row in rows if row.gate} >= {"gap", "accepted"}


@pytest.mark.parametrize(
    ("log", "machine_file"),
    mark_slow_after(
        2,
        [
            ("linear_axis.csv", "linear_axis.toml"),
            ("husky_asphalt.bag", "husky_imu.toml"),
            ("linear_axis.bag", "linear_axis_ros.toml"),
        ],
    ),
)
def test_logs_of_others_are_followed_as_replayed(
    shared_data: Path, tmp_path: Path, log: str, machine_file: str
) -> None:
    data = (shared_data / "logs" / log).read_bytes()
    target = tmp_path / log
    machine = load_machine(REPO / "examples" / machine_file, CAUSAL)

    def record() -> Iterator[None]:
        with target.open("wb") as file:
            for begin in range(0, len(data), len(data) // 100):
                file.write(data[begin : begin + len(data) // 100])
                file.flush()
                yield

    digests = FollowedDigests()
    with Recording(record(), target) as recording:
        _, rows = followed(target, machine, recording)
    digests.add_followed_rows(rows)
    compared = {
        each.name: each
        for each in digests.compare_with_replayed_frames(replayed(target, machine).frames)
    }
    assert compared["gate"].differs_from_s is None
    assert compared["gate"].rows > 300
    # a derived channel is filtered anew from the oldest sample kept, and which that is depends on
    # how much each look finds on disk: the filter forgets where it began but for rounding
    for each in compared.values():
        assert each.is_rounding, each


@pytest.mark.heavy
def test_memory_does_not_grow_with_the_log(logs: dict[str, Path], tmp_path: Path) -> None:
    """What is kept of the samples is the newest seconds, whatever came before."""
    machine = machine_of(logs[".mcap"])
    target = tmp_path / "growing.mcap"
    heights: list[int] = []

    def on_rows(following: FollowedLogState, _: list[FollowedRow]) -> None:
        heights.append(following.follower.log.kept_sample_count)

    recorder = mcap_recorder(logs[".mcap"], target, CompressionType.NONE)
    with Recording(recorder, target):
        following = follow_logs([target], machine, on_rows, idle_s=PATIENT_S)
    assert following.follower.rows_stepped > 2_000
    # three topics at 100 Hz: two seconds are kept, and what a chunk or a look brings at once
    assert heights[-1] < 1_000
