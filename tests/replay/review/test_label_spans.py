"""Labels that the logs give: the text of a topic is on the loads that are dumped while it holds."""

import json
from pathlib import Path

import polars as pl
import pytest
from mcap.writer import Writer

from estimators.errors import PayscopeError
from replay import load_machine
from replay.review.give_verdicts import parse_label_channel, read_label_spans
from tests.replay.shift_review import shift_folder
from tests.replay.sledge import Payscope, join_to_one_line

pytestmark = pytest.mark.usefixtures("kept_replays")

NS = 10**9


def text_log(path: Path, said: list[tuple[int, object]]) -> Path:
    """A log with a topic of texts, at times in unix ns."""
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = {"type": "object", "properties": {"data": {"type": "string"}}}
        kind = writer.register_schema("Text", "jsonschema", json.dumps(schema).encode())
        channel = writer.register_channel("/shift/operator", "json", kind)
        for at_ns, text in said:
            message = json.dumps({"data": text}).encode()
            writer.add_message(channel, at_ns, message, at_ns)
        writer.finish()
    return path


def test_a_stretch_goes_from_a_text_to_the_next_other_one(tmp_path: Path) -> None:
    at = 1_700_000_000
    said = [(at, "A. Kim"), (at + 60, "A. Kim"), (at + 120, "B. Lee"), (at + 180, "")]
    log = text_log(tmp_path / "text.mcap", [(s * NS, text) for s, text in said])
    channel = parse_label_channel("operator=/shift/operator:data")
    found = read_label_spans([log], [channel], load_machine(Path("cat262c.toml")))
    assert [
        (each.operator, each.begin.timestamp() - at, each.end.timestamp() - at)
        for each in found
        if each.begin and each.end
    ] == [("A. Kim", 0.0, 120.0), ("B. Lee", 120.0, 180.0)]
    assert len(found) == 2


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("operator", "LABEL=TOPIC:FIELD"),
        ("driver=/a:b", "no label 'driver'"),
        ("operator=/shift/operators:data", "did you mean '/shift/operator'"),
        ("operator=/shift/operator:name", "data"),
    ],
)
def test_what_is_not_there_is_said_with_what_is(text: str, says: str, tmp_path: Path) -> None:
    log = text_log(tmp_path / "text.mcap", [(NS, "A. Kim")])
    with pytest.raises(PayscopeError, match=says):
        read_label_spans([log], [parse_label_channel(text)], load_machine(Path("cat262c.toml")))


@pytest.mark.heavy
def test_a_review_of_logs_has_the_operator_of_each_load(tmp_path: Path, payscope: Payscope) -> None:
    logs, machine, truth = shift_folder(tmp_path)
    dumps = [each["dump_ns"] for each in truth["cycles"]]
    change_ns = (dumps[1] + dumps[2]) // 2
    said = [(dumps[0] - 60 * NS, "A. Kim"), (change_ns, "B. Lee")]
    more = text_log(tmp_path / "operator.mcap", said)
    out = tmp_path / "review"
    words = ("--label", "operator=/shift/operator:data")
    done = payscope("review", *logs, more, "-m", machine, "-o", out, *words)
    assert done.status == 0, done.err
    table = pl.read_parquet(out / "ledger.parquet")
    assert table["operator"].to_list() == ["A. Kim"] * 2 + ["B. Lee"] * (table.height - 2)
    written = (out / "verdicts.toml").read_text(encoding="utf-8")
    # once more: nothing is said twice
    payscope("review", *logs, more, "-m", machine, "-o", out, *words)
    assert (out / "verdicts.toml").read_text(encoding="utf-8") == written
    join_to_one_line(payscope("review", out, *words), "need the logs")
