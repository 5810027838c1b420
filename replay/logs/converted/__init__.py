"""Converted logs: a folder of Parquet by topic, and the description that makes it a log again."""

from typing import Final

#: Written last: a folder with it is whole.
DESCRIPTION: Final = "payscope-log.json"
