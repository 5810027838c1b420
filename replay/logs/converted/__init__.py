"""Converted logs: a folder with Parquet files by topic, and a description that makes it a log."""

from typing import Final

#: File that is written last, so that a folder with it is complete.
DESCRIPTION: Final = "payscope-log.json"
