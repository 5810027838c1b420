"""The one table of causes: what each is, and what a log must hold for it to be seen."""

from typing import Final

from analysis.findings import timing
from analysis.findings.cause import Cause

CAUSES: Final = (
    Cause(
        "delay",
        "a channel's stamps are late or early against the others",
        "an informative manoeuvre whose force changes",
        timing.delay,
    ),
    Cause(
        "clock_drift",
        "the clocks of two topics run apart",
        "header stamps and log times of two topics",
        timing.clock_drift,
    ),
)
