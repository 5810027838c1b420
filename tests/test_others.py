"""Whether the logs of others are here: each test of them runs on logs of our own in any case."""

from pathlib import Path


def test_the_logs_of_others_are_here(shared_data: Path) -> None:
    assert {"bags", "logs", "mcap_conformance"} <= {path.name for path in shared_data.iterdir()}
