"""What `scan_log` gives equals what `read` gives, and asks the index for no more than it needs."""

import re
import warnings
from collections.abc import Callable, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import polars as pl
import pytest

import payscope
from estimators.errors import LogError
from replay import open_log
from replay.frames.scan import expand_log_paths
from replay.logs.blocks.block import Block
from tests.replay.logs.conftest import write_log  # noqa: F401 - a fixture
from tests.replay.logs.written_logs import Joints, write_bag, write_mcap

AS_READ: dict[str, Any] = {"enums": "number", "times": "ns"}
START_NS = 1_700_000_000_000_000_000
STEP_NS = 10_000_000


@pytest.fixture(scope="module")
def own_logs(own_data: Path) -> list[Path]:
    return sorted([*own_data.glob("logs/*"), *own_data.glob("bags/*")])


def joints(count: int, topic: str = "/joints", start_ns: int = START_NS) -> list[Joints]:
    """Every tenth message was recorded before the one in front of it."""
    return [
        Joints(
            start_ns + (k - 3 * (k % 10 == 9)) * STEP_NS,
            {"left": float(k), "right": -float(k)},
            topic,
            START_NS + k * STEP_NS,
        )
        for k in range(count)
    ]


def time(step: int) -> datetime:
    return datetime.fromtimestamp(START_NS // 10**9, UTC) + timedelta(microseconds=step * 10_000)


@pytest.mark.heavy
def test_every_topic_of_every_log_is_as_read_with_its_losses(own_logs: list[Path]) -> None:
    compared = 0
    for path in own_logs:
        try:
            topics = open_log(path).topics()
        except LogError as error:
            with pytest.raises(LogError, match=re.escape(str(error))):
                payscope.scan_log(path, "table")
            continue
        for row in topics.filter(pl.col("problem").is_null()).iter_rows(named=True):
            fresh = open_log(path)
            losses: list[Any] = []
            try:
                read = fresh.read(row["topic"], row["fields"])
            except LogError as error:
                with pytest.raises(LogError, match=re.escape(str(error))):
                    payscope.scan_log(path, row["topic"]).collect()
                continue
            lazy = payscope.scan_log(path, row["topic"], losses=losses, **AS_READ)
            assert lazy.collect_schema() == read.schema
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", payscope.LossWarning)
                found = lazy.collect()
            assert found.equals(read), (path, row["topic"])
            assert set(losses) >= set(fresh.losses())
            compared += 1
    assert compared > 20


def test_a_time_range_a_projection_and_a_limit_are_as_read(
    write_log: Callable[[Sequence[Joints]], Path],  # noqa: F811
) -> None:
    path = write_log(joints(200))
    lazy = payscope.scan_log(path, "/joints", fields=["effort[right]", "header.stamp"], **AS_READ)
    first, last = START_NS + 50 * STEP_NS, START_NS + 90 * STEP_NS
    read = open_log(path).read("/joints", ["effort[right]"], first, last)
    between = lazy.filter(pl.col("log_time_ns").is_between(first, last))
    assert (
        between.select("log_time_ns", "effort[right]")
        .collect()
        .equals(read.drop("header_stamp_ns"))
    )
    assert lazy.head(7).collect().equals(lazy.collect().head(7))
    assert (
        lazy.head(7)
        .filter(pl.col("log_time_ns") > START_NS)
        .collect()
        .equals(lazy.collect().head(7).filter(pl.col("log_time_ns") > START_NS))
    )
    some = (pl.col("effort[right]") < -30) & (pl.col("log_time_ns") < last)
    assert lazy.filter(some).collect().equals(lazy.collect().filter(some))


def test_a_time_range_unpacks_the_chunks_that_hold_it_and_no_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import replay.logs.blocks.block_groups as block_groups

    path = tmp_path / "shift.bag"
    write_bag(path, joints(2000), chunk_bytes=4000)
    unpacked: list[Block] = []
    unpack = block_groups.unpack_block_into

    def counted(block: Block, *rest: Any) -> int:
        unpacked.append(block)
        return unpack(block, *rest)

    monkeypatch.setattr(block_groups, "unpack_block_into", counted)
    lazy = payscope.scan_log(path, "/joints")
    lazy.select("log_time").collect()
    whole, unpacked[:] = len(unpacked), []
    within = pl.col("log_time").is_between(time(1000), time(1040))
    assert (
        lazy.filter(within & (pl.col("effort[]").list.len() == 2)).select(pl.len()).collect()[0, 0]
    )
    assert whole > 50
    holding = [b for b in unpacked if b.last_ns >= START_NS + 1000 * STEP_NS]
    assert len(unpacked) == len(holding) <= 6


def test_a_limit_ends_the_reading(tmp_path: Path) -> None:
    write_bag(tmp_path / "shift.bag", joints(40))
    assert payscope.scan_log(tmp_path / "shift.bag", "/joints").head(3).collect().height == 3


def test_several_logs_have_a_column_that_tells_them_apart(tmp_path: Path) -> None:
    for name, begin in (("b.bag", 100), ("a.bag", 0)):
        write_bag(tmp_path / name, joints(20, start_ns=START_NS + begin * STEP_NS))
    write_bag(tmp_path / "c.bag", joints(5, topic="/other"))
    losses: list[Any] = []
    lazy = payscope.scan_log(tmp_path / "*.bag", "/joints", losses=losses)
    with pytest.warns(payscope.LossWarning, match="does not have the topic"):
        found = lazy.collect()
    assert found["source"].unique(maintain_order=True).to_list() == [
        str(tmp_path / "a.bag"),
        str(tmp_path / "b.bag"),
    ]
    assert [str(loss.source) for loss in losses] == ["c.bag"]
    one = lazy.filter(pl.col("source").str.ends_with("b.bag")).collect()
    assert one.equals(found.filter(pl.col("source").str.ends_with("b.bag")))


def test_a_log_that_the_filter_excludes_is_not_opened(tmp_path: Path) -> None:
    write_bag(tmp_path / "a.bag", joints(5))
    (tmp_path / "b.bag").write_bytes(b"no bag")
    lazy = payscope.scan_log(tmp_path / "*.bag", "/joints")
    assert lazy.filter(pl.col("source").str.ends_with("a.bag")).collect().height == 5
    with pytest.raises(LogError, match="not a ROS 1 bag"):
        lazy.collect()


def test_logs_whose_field_changed_its_type_are_named(tmp_path: Path) -> None:
    pl.DataFrame({"time_s": [0.0, 1.0], "x": [1, 2]}).write_parquet(tmp_path / "a.parquet")
    pl.DataFrame({"time_s": [0.0, 1.0], "x": ["a", "b"]}).write_parquet(tmp_path / "b.parquet")
    with pytest.raises(LogError, match=r"b\.parquet: topic 'table' has 'x' as String"):
        payscope.scan_log([tmp_path / "a.parquet", tmp_path / "b.parquet"], "table").collect()


def test_a_log_that_changes_is_opened_again(tmp_path: Path) -> None:
    write_bag(tmp_path / "shift.bag", joints(5))
    lazy = payscope.scan_log(tmp_path / "shift.bag", "/joints")
    assert lazy.collect().height == 5
    (tmp_path / "shift.bag").unlink()
    write_bag(tmp_path / "shift.bag", joints(8))
    assert lazy.collect().height == 8


def test_the_nearest_row_of_another_topic_is_joined(tmp_path: Path) -> None:
    late = [*joints(30), *joints(30, "/other", START_NS + 2_000_000)]
    write_mcap(tmp_path / "shift.mcap", late)
    left, right = (
        payscope.scan_log(tmp_path / "shift.mcap", t, fields=["effort[left]"])
        for t in ("/joints", "/other")
    )
    joined = payscope.join_topics(left, right, tolerance="5ms").collect()
    assert joined.height == 30
    assert joined["log_time_right"].null_count() == 30  # 8 ms ago, or 2 ms later
    joined = payscope.join_topics(left, right, tolerance="5ms", strategy="nearest").collect()
    assert (joined["log_time_right"] - joined["log_time"]).unique().to_list() == [
        timedelta(milliseconds=2)
    ]


@pytest.mark.parametrize(
    ("logs", "fault"),
    [
        ("nowhere/*.bag", "no log matches this pattern"),
        ([], "no log is given"),
        ("nowhere.bag", "no such file"),
    ],
)
def test_logs_that_are_not_there_are_named_at_once(logs: Any, fault: str) -> None:
    with pytest.raises(LogError, match=fault):
        payscope.scan_log(logs, "/joints")


def test_an_unknown_topic_and_field_are_named_at_once(tmp_path: Path) -> None:
    write_bag(tmp_path / "shift.bag", joints(5))
    with pytest.raises(LogError, match="did you mean '/joints'"):
        payscope.scan_log(tmp_path / "shift.bag", "/joint")
    with pytest.raises(LogError, match="no field 'efort'"):
        payscope.scan_log(tmp_path / "shift.bag", "/joints", fields=["efort"])


def test_a_folder_is_its_logs(tmp_path: Path) -> None:
    write_bag(tmp_path / "a.bag", joints(2))
    assert expand_log_paths(tmp_path) == ([tmp_path / "a.bag"], True)
    assert expand_log_paths(tmp_path / "a.bag") == ([tmp_path / "a.bag"], False)
