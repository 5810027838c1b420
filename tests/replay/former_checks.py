"""Runs, texts and tables as versions wrote them before checks had their present names."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import polars as pl

from analysis import Run
from analysis.model.check_names import PRESENT_NAMES

#: What a check was called, by its present name.
FORMER_NAMES: Final[Mapping[str, str]] = {now: old for old, now in PRESENT_NAMES.items()}


def former_list(text: str) -> str:
    """A list of checks with their former names."""
    return ", ".join(FORMER_NAMES.get(name, name) for name in text.split(", "))


def run_with_former_names(run: Run) -> Run:
    """The run with former names of checks, and the fingerprint that it had with them."""
    listed = pl.col("withheld_for").map_elements(former_list, return_dtype=pl.String)
    frames = {
        **run.frames,
        "verdict": run.frames["verdict"].with_columns(pl.col("check").replace(FORMER_NAMES)),
        "loads": run.frames["loads"].with_columns(listed),
        "cycles": run.frames["cycles"].with_columns(listed),
    }
    return replace(run, frames=frames).with_fingerprint()
