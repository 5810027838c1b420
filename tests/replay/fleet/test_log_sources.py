"""The logs that sources name, and how long they still take."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from estimators.errors import FleetError
from replay.commands.progress_bar import RemainingTimeEstimator, format_time_left
from replay.fleet.log_sources import list_logs_of_sources
from replay.fleet.object_store import ObjectStore
from replay.logs import group_objects_by_log


def test_folders_globs_and_logs_are_each_log_once(tmp_path: Path) -> None:
    for name in ("a/one.mcap", "a/two.bag", "b/three.mcap", "b/notes.csv", "b/bag/metadata.yaml"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(b"x" * 7)
    (tmp_path / "b/bag/data.mcap").write_bytes(b"y" * 5)
    sources = [str(tmp_path), f"{tmp_path}/**/*.mcap", str(tmp_path / "a/one.mcap")]
    found = {
        Path(log.source).relative_to(tmp_path).as_posix(): log
        for log in list_logs_of_sources(sources)
    }
    assert set(found) == {"a/one.mcap", "a/two.bag", "b/three.mcap", "b/bag", "b/bag/data.mcap"}
    assert found["b/bag"].size_bytes == 12
    assert list(found) == sorted(found)


@pytest.mark.parametrize("source", ["nowhere", "*.mcap", ""])
def test_a_source_without_a_log_is_said(source: str, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(FleetError, match="contains no log"):
        list_logs_of_sources([str(tmp_path / "empty" / source)])


def test_in_a_storage_without_folders_a_bag_is_a_file_or_a_directory_with_metadata() -> None:
    names = ["x/metadata.yaml", "x/x_0.db3", "x/x_1.db3", "y/a.bag", "y/ledger.csv"]
    assert group_objects_by_log(names) == {
        "x": ["x/metadata.yaml", "x/x_0.db3", "x/x_1.db3"],
        "y/a.bag": ["y/a.bag"],
    }
    # tables only where there is nothing else
    assert group_objects_by_log(["z/t.parquet", "z/readme.md"]) == {"z/t.parquet": ["z/t.parquet"]}


def test_what_is_being_written_to_a_folder_is_not_among_its_objects(tmp_path: Path) -> None:
    store = ObjectStore(str(tmp_path))
    store.write_object("a/b=1/whole.parquet", b"1")
    # as a writer that was killed leaves it
    (tmp_path / "a/b=1/torn.parquet#1").write_bytes(b"")
    assert store.list_names("a") == ["a/b=1/whole.parquet"]
    assert [each.name for each in store.list_objects("a")] == ["a/b=1/whole.parquet"]


def test_nothing_is_said_of_the_time_left_before_some_are_done() -> None:
    left = RemainingTimeEstimator([1000] * 10)
    for _ in range(4):
        left.add_finished_recording(1000, 1.0)
    assert left.estimate_time_left_interval_s(1) is None
    assert format_time_left(None) == ""


@pytest.mark.heavy
@given(
    st.integers(1, 16),
    st.lists(st.integers(10**6, 10**9), min_size=12, max_size=60),
    st.floats(0.01, 10.0),
)
def test_where_seconds_go_with_size_the_time_left_is_exact(
    slots: int, sizes: list[int], rate: float
) -> None:
    left = RemainingTimeEstimator(sizes)
    for size in sizes[:6]:
        left.add_finished_recording(size, rate * (size + 2_000_000) / 1e6)
    rest = sum(rate * (size + 2_000_000) / 1e6 for size in sizes[6:]) / slots
    low, high = left.estimate_time_left_interval_s(slots) or (0.0, 0.0)
    assert low == pytest.approx(rest, rel=1e-3)
    assert high == pytest.approx(rest, rel=1e-3)


def test_what_scatters_has_an_interval_in_a_unit_that_suits_it() -> None:
    left = RemainingTimeEstimator([1000] * 1000)
    for n in range(10):
        left.add_finished_recording(1000, 5.0 + 5.0 * (n % 2))
    low, high = left.estimate_time_left_interval_s(2) or (0.0, 0.0)
    assert low < 990 * 7.5 / 2 < high
    assert format_time_left((low, high)).endswith(" min left")
    assert format_time_left((20.0, 30.0)) == "20 to 30 s left"
    assert format_time_left((7200.0, 10800.0)) == "2.0 to 3.0 h left"
