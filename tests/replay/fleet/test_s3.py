"""A fleet in object storage, on a real server that goes away in the middle of a run."""

import os
from pathlib import Path

import pytest

from benchmarks.fleet_logs import SerialEngine
from benchmarks.fleet_s3 import Server, checked
from estimators.errors import PayscopeError
from replay.fleet.log_sources import list_logs_of_sources
from replay.fleet.object_store import ObjectStore
from tests.one_line import assert_one_line

AWS = ("AWS_ENDPOINT_URL", "AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY", "AWS_REGION")


@pytest.fixture(autouse=True)
def given_back(monkeypatch: pytest.MonkeyPatch) -> None:
    """The environment is as it was before."""
    for name in AWS:
        monkeypatch.setenv(name, os.environ.get(name, ""))


@pytest.mark.heavy
def test_runs_and_queries_with_the_server_away_for_a_while(tmp_path: Path) -> None:
    assert checked(tmp_path, "twin", 2, 1.5, SerialEngine) == []


def test_objects_are_listed_read_and_written_whole(tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    server = Server(tmp_path)
    os.environ.update(server.environment)
    server.start()
    try:
        store = ObjectStore("s3://parts/some/place")
        assert store.list_objects() == []
        store.write_object("a/b.bin", bytes(range(256)) * 100)
        assert [(each.name, each.size_bytes) for each in store.list_objects("a")] == [
            ("a/b.bin", 25600)
        ]
        store.download_object_to_file("a/b.bin", tmp_path / "fetched")
        assert (tmp_path / "fetched").read_bytes() == store.read_object("a/b.bin")
        assert not store.has_object("a/c.bin")
        with pytest.raises(FileNotFoundError):
            store.read_object("a/c.bin")
        # one object is a source as well
        ObjectStore("s3://parts").write_object("logs/x.csv", b"t\n")
        (log,) = list_logs_of_sources(["s3://parts/logs/x.csv"])
        assert (log.source, log.names) == ("s3://parts/logs/x.csv", ("logs/x.csv",))
        with pytest.raises(PayscopeError) as fault:
            list_logs_of_sources(["s3://parts/nothing"])
        assert_one_line(fault.value)
    finally:
        server.stop()
