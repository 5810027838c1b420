"""Tear off the end of a written log, as where a recorder loses its power."""

from pathlib import Path

from replay.logs.writers.rosbag2_writer import METADATA


def tear(log: Path, share: float) -> None:
    """Cut off so much of a log's file, at any byte; a directory loses its metadata as well.

    Args:
        log: a file, or a rosbag2 directory of one storage file.
        share: from 0 to 1.
    """
    if log.is_dir():
        (log / METADATA).unlink()
        (log,) = log.iterdir()
    size = log.stat().st_size
    with log.open("r+b") as file:
        file.truncate(size - round(size * share))
