"""`payscope convert`: Parquet by topic, a log again; taken up where it was killed."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import duckdb
import polars as pl
import pyarrow.parquet
import pytest

import payscope as api
from analysis.simulation import Scenario
from estimators.errors import LogError, OutputError
from replay import load_machine, open_log, run
from replay.convert.convert_log import convert_log
from replay.convert.unfinished_folder import open_unfinished_folder
from replay.logs import expand_log_folders
from replay.logs.converted import DESCRIPTION
from replay.simulation.simulate_logs import simulate_scenario_to_logs
from tests.one_line import assert_one_line
from tests.replay.logs.written_logs import Joints, write_bag, write_mcap
from tests.replay.sledge import Payscope, join_to_one_line

START_NS = 1_700_000_000_000_000_000


@pytest.fixture(scope="module")
def own_logs(own_data: Path) -> list[Path]:
    return sorted([*own_data.glob("logs/*"), *own_data.glob("bags/*")])


def joints(count: int, topic: str = "/joints") -> list[Joints]:
    return [
        Joints(START_NS + k * 10_000_000, {"left": k / 2, "right": -k / 2}, topic)
        for k in range(count)
    ]


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    path = tmp_path / "shift.bag"
    write_bag(path, [*joints(400), *joints(30, "/rare one")], chunk_bytes=4000)
    return path


def converted(path: Path, target: Path, **options: Any) -> Path:
    with open_log(path) as log:
        convert_log(log, target, **options)
    return target


@pytest.mark.heavy
def test_every_log_is_itself_again(own_logs: list[Path], tmp_path: Path) -> None:
    compared = 0
    for path in own_logs:
        try:
            log = open_log(path)
        except LogError:
            continue
        span = max(1, log.topics()["messages"].sum() // 4)
        back = open_log(converted(path, tmp_path / path.name, span_messages=span))
        assert back.topics().equals(log.topics()), path
        for row in log.topics().filter(pl.col("problem").is_null()).iter_rows(named=True):
            topic, fields = row["topic"], list(row["fields"])
            try:
                read = log.read(topic, fields)
            except LogError:
                with pytest.raises(LogError, match="cannot be read"):
                    back.read(topic, fields)
                continue
            assert back.read(topic, fields).equals(read), (path, topic)
            assert back.leaf_fields(topic) == log.leaf_fields(topic)
            compared += 1
        assert set(back.losses()) >= {*log.losses()}, path
        assert back.check().messages == sum(
            log.read(t, []).height for t in log.topic_names() if _can_be_read(log, t)
        )
    assert compared > 20


def _can_be_read(log: Any, topic: str) -> bool:
    try:
        log.read(topic, [])
    except LogError:
        return False
    return True


def test_elements_and_times_are_as_the_log_gives_them(bag: Path, tmp_path: Path) -> None:
    back, log = open_log(converted(bag, tmp_path / "shift", span_messages=100)), open_log(bag)
    fields = ["effort[right]", "effort[0]", "effort[9]", "effort[nobody]", "name[1]"]
    assert back.read("/joints", fields).equals(log.read("/joints", fields))
    first, last = START_NS + 990_000_000, START_NS + 1_010_000_000
    within = log.read("/joints", fields, first, last)
    assert within.height == 3
    assert back.read("/joints", fields, first, last).equals(within)
    assert back.read("/joints", fields, 0, 1).equals(log.read("/joints", fields, 0, 1))
    lazy = api.scan_log(tmp_path / "shift", "/joints", fields=fields)
    assert lazy.collect().equals(api.scan_log(bag, "/joints", fields=fields).collect())
    for wrong in ("nosuch", "effort[left", "header", "log_time_ns", "header.stamp[0]"):
        with pytest.raises(LogError) as fault:
            back.read("/joints", [wrong])
        assert_one_line(fault.value)


@pytest.mark.heavy
def test_a_run_gives_the_same_answer(tmp_path: Path) -> None:
    short = Scenario()
    campaign = short.campaign.model_copy(update={"loads_kg": (50.0,), "runs": 2})
    simulate_scenario_to_logs(
        short.model_copy(update={"campaign": campaign}), tmp_path / "shift.bag"
    )
    folder = converted(tmp_path / "shift.bag", tmp_path / "shift", span_messages=2000)
    machine = load_machine("cat262c.toml")
    with open_log(tmp_path / "shift.bag") as log, open_log(folder) as back:
        ours, theirs = run(log, machine), run(back, machine)
    assert list(theirs.frames) == list(ours.frames)
    for name, frame in ours.frames.items():
        assert theirs.frames[name].equals(frame), name
    assert ours.provenance.fingerprint is not None
    assert theirs.provenance.fingerprint is not None
    assert theirs.provenance.fingerprint.results == ours.provenance.fingerprint.results


def test_info_gives_the_same_answer(bag: Path, tmp_path: Path, payscope: Payscope) -> None:
    assert payscope("convert", bag, "-o", tmp_path / "shift").status == 0
    said = [json.loads(payscope("info", each, "--json").out) for each in (bag, tmp_path / "shift")]
    for each in said:
        del each["path"], each["format"], each["size_bytes"]
    assert said[0] == said[1]
    assert payscope("info", tmp_path / "shift", "--check").status == 0


def test_others_read_the_files_and_what_they_are_of(bag: Path, tmp_path: Path) -> None:
    folder = converted(bag, tmp_path / "shift", span_messages=100)
    files = sorted((folder / "joints").iterdir())
    assert len(files) == 5
    schema = pyarrow.parquet.read_schema(files[0])
    about = {key.decode(): value.decode() for key, value in (schema.metadata or {}).items()}
    assert about["payscope.topic"] == "/joints"
    assert about["payscope.type"] == "sensor_msgs/msg/JointState"
    assert "float64[] effort" in about["payscope.definition"]
    [source] = json.loads(about["payscope.log_files"])
    assert source["sha256"] == open_log(bag).digests[0]
    assert schema.field("log_time_ns").metadata == {b"unit": b"ns"}
    files = f"read_parquet('{folder}/joints/*.parquet')"
    sql = f'SELECT count(*), max("effort[]"[1]) FROM {files}'
    assert duckdb.sql(sql).fetchall() == [(400, 199.5)]
    assert pl.read_parquet(folder / "rare_one").height == 30


KILLED = """
import sys, time
from pathlib import Path
from replay.convert import unfinished_folder
from replay.convert.convert_log import convert_log
from replay.logs import open_log
write = unfinished_folder.PartWriter.append_rows
def slowly(self, rows):
    print("writing", flush=True)
    time.sleep(0.02)
    write(self, rows)
unfinished_folder.PartWriter.append_rows = slowly
with open_log(Path(sys.argv[1])) as log:
    made = convert_log(log, Path(sys.argv[2]), span_messages=40)
print("taken up", made.resumed_spans, "of", made.spans)
"""


@pytest.mark.heavy
def test_a_conversion_killed_anywhere_is_taken_up(bag: Path, tmp_path: Path) -> None:
    whole = converted(bag, tmp_path / "whole", span_messages=40)
    target, words = tmp_path / "shift", [sys.executable, "-c", KILLED, str(bag)]
    taken_up: list[int] = []
    for writes in (1, 4, 3):
        with subprocess.Popen([*words, target], stdout=subprocess.PIPE, text=True) as child:
            assert child.stdout is not None
            for _ in range(writes):
                assert child.stdout.readline() == "writing\n"
            time.sleep(0.01)
            child.kill()
            assert child.wait() == -signal.SIGKILL
        assert not target.exists()
        unfinished = tmp_path / "shift.unfinished"
        taken_up.append(len(list(unfinished.glob("span-*.json"))))
    assert taken_up == sorted(taken_up)
    assert taken_up[-1] >= 3
    done = subprocess.run([*words, target], capture_output=True, text=True, check=True)
    assert done.stdout.endswith(f"taken up {taken_up[-1]} of 11\n")
    assert not (tmp_path / "shift.unfinished").exists()
    assert _contents(target) == _contents(whole)


def _contents(folder: Path) -> dict[str, bytes]:
    return {
        each.relative_to(folder).as_posix(): each.read_bytes()
        for each in sorted(folder.rglob("*"))
        if each.is_file()
    }


def test_another_log_does_not_take_up_what_is_of_this_one(bag: Path, tmp_path: Path) -> None:
    unfinished = tmp_path / "shift.unfinished"
    with open_log(bag) as log, pytest.raises(KeyboardInterrupt):
        convert_log(log, tmp_path / "shift", on_span=_interrupt_third, span_messages=40)
    assert len(list(unfinished.glob("span-*.json"))) == 2
    other = tmp_path / "other.mcap"
    write_mcap(other, joints(90))
    with open_log(other) as log:
        made = convert_log(log, tmp_path / "shift", span_messages=40)
    assert (made.resumed_spans, made.row_count) == (0, 90)
    assert {each.name for each in (tmp_path / "shift").iterdir()} == {"joints", DESCRIPTION}


def _interrupt_third(stage: str) -> None:
    if stage.startswith("convert 3"):
        raise KeyboardInterrupt


def test_a_damaged_log_is_converted_in_one_go_with_its_losses(bag: Path, tmp_path: Path) -> None:
    whole = bag.read_bytes()
    torn = tmp_path / "torn.bag"
    torn.write_bytes(whole[:14_000] + whole[14_010:])
    with open_log(torn) as log:
        made = convert_log(log, tmp_path / "torn", span_messages=40)
    log = open_log(torn)
    read = log.read("/joints", ["effort[]"])
    assert (made.spans, made.resumed_spans) == (1, 0)
    assert 300 < read.height < 400
    back = open_log(tmp_path / "torn")
    assert back.read("/joints", ["effort[]"]).equals(read)
    assert set(back.losses()) == set(log.losses()) != set()


def test_topics_are_chosen_and_an_output_is_kept(
    bag: Path, tmp_path: Path, payscope: Payscope
) -> None:
    out = tmp_path / "shift"
    said = payscope("convert", bag, "-o", out, "--topic", "/joints", "--json")
    assert said.status == 0
    assert [each["topic"] for each in json.loads(said.out)["topics"]] == ["/joints"]
    join_to_one_line(payscope("convert", bag, "-o", out), "exists already", "--force")
    assert payscope("convert", bag, "-o", out, "--force").status == 0
    assert open_log(out).topic_names() == ["/joints", "/rare one"]
    assert expand_log_folders([out]) == [out]
    join_to_one_line(payscope("convert", bag, "-o", bag, "--force"), "is also an input")
    join_to_one_line(payscope("convert", bag, "-o", tmp_path / "no/where"), "create it first")
    join_to_one_line(
        payscope("convert", bag, "-o", tmp_path / "x", "--topic", "/joint"), "'/joints'?"
    )
    (tmp_path / "mine").mkdir()
    join_to_one_line(payscope("convert", bag, "-o", tmp_path / "mine", "--force"), "is a folder")


def test_two_conversions_to_one_folder_are_one_too_many(bag: Path, tmp_path: Path) -> None:
    with open_unfinished_folder(tmp_path / "shift"), pytest.raises(OutputError) as refused:
        converted(bag, tmp_path / "shift")
    assert "another process" in str(refused.value)
    assert_one_line(refused.value)


def test_a_folder_of_another_kind_is_not_replaced_with_force(
    bag: Path, tmp_path: Path, payscope: Payscope
) -> None:
    evidence = tmp_path / "evidence"
    evidence.mkdir()
    (evidence / "evidence.json").write_text("{}")
    said = payscope("convert", bag, "-o", evidence, "--force")
    join_to_one_line(said, "is evidence, which is not replaced by a converted log")
    assert [each.name for each in evidence.iterdir()] == ["evidence.json"]


def test_a_folder_that_was_changed_says_so(bag: Path, tmp_path: Path, payscope: Payscope) -> None:
    folder = converted(bag, tmp_path / "shift")
    part = folder / "rare_one/part-00000.parquet"
    pl.read_parquet(part).with_columns(pl.lit(1.0).alias("x")).write_parquet(part)
    said = payscope("info", folder, "--check")
    assert said.status == 1
    assert "digests differ" in said.out
    part.write_bytes(part.read_bytes()[:500])
    with pytest.raises(LogError) as fault:
        open_log(folder).read("/rare one", [])
    assert_one_line(fault.value)
    part.unlink()
    join_to_one_line(
        payscope("info", folder), "rare_one/part-00000.parquet", "convert the log again"
    )
    (folder / DESCRIPTION).write_text("{}")
    join_to_one_line(payscope("info", folder), "was changed after payscope wrote it")
