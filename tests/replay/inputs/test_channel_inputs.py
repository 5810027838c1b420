"""What a replay takes from several logs of one time line."""

from pathlib import Path

import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader

from estimators.errors import LogError
from recordings import read_recording, write_recording
from replay import load_machine, open_log, run
from replay.inputs.channel_inputs import name_raw_frames_by_topic, read_channel_fields_and_losses
from tests.replay.logs.written_logs import Joints, write_mcap
from tests.replay.sledge import MACHINE, sledge

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"


def read(machine_file: Path, *tables: pl.DataFrame) -> pl.DataFrame:
    """The one topic of tables that are written beside the machine file."""
    logs: list[Path] = []
    for number, table in enumerate(tables):
        logs.append(machine_file.with_name(f"part_{number}.csv"))
        table.write_csv(logs[-1])
    raw, _ = read_channel_fields_and_losses(
        [open_log(path) for path in logs], load_machine(machine_file)
    )
    return raw["table"]


@given(st.sets(st.text("/ab", max_size=4)))
def test_topics_have_distinct_names_in_a_run_whatever_they_are(topics: set[str]) -> None:
    named = name_raw_frames_by_topic({topic: pl.DataFrame({"of": [topic]}) for topic in topics})
    assert {frame.item() for frame in named.values()} == topics
    assert all(name.startswith("raw/") for name in named)


@pytest.mark.heavy
def test_a_topic_with_a_slash_and_one_without_are_two_in_the_recording(tmp_path: Path) -> None:
    log, machine_file = tmp_path / "shift.mcap", tmp_path / "sledge.toml"
    recorded = [
        Joints(round(row["time_s"] * 1e9) + 1, {joint: row[joint]}, topic=topic)
        for row in sledge(20.0).iter_rows(named=True)
        for topic, joint in (("/drive", "force_N"), ("drive", "speed_m_s"), ("/acc", "acc_m_s2"))
    ]
    write_mcap(log, recorded)
    machine_file.write_text(
        MACHINE.replace('[log]\ntime = "time_s"\n', "")
        .replace('field = "force_N"', 'topic = "/drive"\nfield = "effort[force_N]"')
        .replace('field = "speed_m_s"', 'topic = "drive"\nfield = "effort[speed_m_s]"')
        .replace('field = "acc_m_s2"', 'topic = "/acc"\nfield = "effort[acc_m_s2]"')
    )
    result = run(open_log(log), load_machine(machine_file))
    fields = {name: f.columns[-1] for name, f in result.frames.items() if name.startswith("raw/")}
    assert fields == {
        "raw//drive": "effort[force_N]",
        "raw/drive": "effort[speed_m_s]",
        "raw/acc": "effort[acc_m_s2]",
    }
    write_recording(result, tmp_path / "shift.rrd")
    assert read_recording(tmp_path / "shift.rrd") == result


def test_logs_in_any_order_are_one_time_line(machine_file: Path) -> None:
    whole = sledge()
    first, last = whole[:1500], whole[1500:]
    assert read(machine_file, last, first).equals(read(machine_file, whole))


def test_a_column_of_whole_numbers_in_one_log_joins_fractions_in_the_next(
    machine_file: Path,
) -> None:
    whole = sledge()
    standing = whole[:100].with_columns(pl.lit(0).alias("force_N"))
    joined = read(machine_file, standing, whole[100:])
    assert joined["force_N"].dtype == pl.Float64
    assert joined["force_N"][99:101].to_list() == [0.0, whole["force_N"][100]]


def test_tables_of_one_time_are_refused_not_shuffled_into_one(machine_file: Path) -> None:
    """Each sample of the one would stand between two of the other: a mass of neither."""
    first = sledge().with_columns(pl.col("time_s") + 5000.0)
    other = sledge(mass_kg=200.0).with_columns(pl.col("time_s") + 5000.005)
    with pytest.raises(
        LogError, match=r"part_1\.csv.* begins 39\.985 s before its end in .*0\.csv"
    ):
        read(machine_file, first, other)


def test_a_topic_that_is_wholly_damaged_is_refused_with_what_was_lost(
    machine_file: Path, tmp_path: Path
) -> None:
    log = tmp_path / "shift.mcap"
    write_mcap(log, [Joints(k, {"slide": 1.0}) for k in range(1, 4)], chunk_size=10_000)
    data = bytearray(log.read_bytes())
    with log.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    chunk = summary.chunk_indexes[0]
    data[chunk.chunk_start_offset + chunk.chunk_length - 20] ^= 0x10
    log.write_bytes(data)
    columns = ("force_x_N", "speed_x_m_s", "acc_x_m_s2")
    machine = load_machine(
        machine_file,
        [f"channels.{name}.topic=/joints" for name in columns]
        + [f"channels.{name}.field=effort[slide]" for name in columns],
    )
    with pytest.raises(LogError, match=r"topic '/joints' has no messages: .*log time"):
        read_channel_fields_and_losses([open_log(log)], machine)


def test_parts_of_a_split_recording_may_reach_into_each_other_a_little(machine_file: Path) -> None:
    whole = sledge()
    parts = (
        whole.filter(pl.int_range(pl.len()).is_between(0, 1549) & ~even_after(1450)),
        (whole.filter((pl.int_range(pl.len()) >= 1550) | even_after(1450))),
    )
    assert read(machine_file, *parts).equals(read(machine_file, whole))


def even_after(row: int) -> pl.Expr:
    number = pl.int_range(pl.len())
    return (number >= row) & (number % 2 == 0)


def test_a_joint_that_no_message_has_is_answered_with_the_nearest(
    own_data: Path,
) -> None:
    machine = load_machine(
        EXAMPLES / "husky_imu.toml", ["channels.torque_left_N_m.field='effort[lef]'"]
    )
    with (
        open_log(own_data / "logs/husky_asphalt.bag") as log,
        pytest.raises(LogError, match=r"no 'lef' .* did you mean 'left'\?"),
    ):
        read_channel_fields_and_losses([log], machine)


@pytest.mark.heavy
def test_a_hint_whose_topic_is_missing_or_empty_is_a_loss_and_stops_nothing(
    machine_file: Path, tmp_path: Path
) -> None:
    sledge().write_csv(tmp_path / "shift.csv")
    plain = load_machine(machine_file)
    hint = plain.channels["force_x_N"].model_copy(update={"topic": "/gps", "field": "latitude"})
    hinted = plain.model_copy(update={"channels": {**plain.channels, "latitude_deg": hint}})
    result = run(open_log(tmp_path / "shift.csv"), hinted)
    assert [str(loss) for loss in result.provenance.losses] == [
        "shift.csv: no topic '/gps'; known: table. "
        "Set channels.latitude_deg.topic in the machine file."
    ]
    without = run(open_log(tmp_path / "shift.csv"), plain)
    assert result.frames["masses"].equals(without.frames["masses"])


def test_a_log_from_which_nothing_is_read_is_told(tmp_path: Path, machine_file: Path) -> None:
    sledge().write_csv(tmp_path / "shift.csv")
    write_mcap(tmp_path / "other.mcap", [Joints(1_000, {"slide": 1.0})])
    logs = [open_log(tmp_path / name) for name in ("shift.csv", "other.mcap")]
    raw, losses = read_channel_fields_and_losses(logs, load_machine(machine_file))
    assert [str(loss) for loss in losses] == [
        "other.mcap: has no topic of the machine file: nothing is read from it"
    ]
    assert raw["table"].height == sledge().height


def test_a_topic_that_a_damaged_log_does_not_have_is_told_with_the_damage(
    tmp_path: Path, machine_file: Path
) -> None:
    log = tmp_path / "torn.mcap"
    write_mcap(log, [Joints(1000, {"slide": 1.0})])
    log.write_bytes(log.read_bytes()[:20])
    machine = load_machine(machine_file, ["channels.force_x_N.topic=/drive"])
    with pytest.raises(LogError, match=r"no topic '/drive'.* It is damaged: torn.mcap: breaks off"):
        read_channel_fields_and_losses([open_log(log)], machine)
