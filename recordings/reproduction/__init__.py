"""The paper found anew, as files: a Markdown page or CSV files, and a picture a figure."""

from recordings.reproduction.page import check_reproduction, write_reproduction

__all__ = ["check_reproduction", "write_reproduction"]
