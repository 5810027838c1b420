"""Reasons for and against weighing a later log by a calibration."""

from collections.abc import Mapping
from typing import Final

import polars as pl

from analysis.calibration.line.shared_errors import SharedErrors
from analysis.calibration.use.apply_calibration import LaterLog
from analysis.calibration.use.learnt_priors import contradicted_priors, undetectable_changes
from analysis.model.machine import Body

#: What it takes of a replay; the last two a replay under learnt priors has.
FRAMES: Final = ("loads", "nuisances", "responses", "learnt_errors")


def describe_later_log(
    frames: Mapping[str, pl.DataFrame], body: Body, refused: str = ""
) -> LaterLog:
    """Gather it.

    Args:
        frames: `FRAMES`, of a replay with the priors that the calibration learnt.
        body: the machine with the empty mass that the calibration has.
        refused: why nothing of the log is to be calibrated, if that is known already.
    """
    nuisances, shared_errors = frames["nuisances"], SharedErrors.from_frames(frames)
    return LaterLog(
        refused or contradicted_priors(nuisances),
        shared_errors,
        body.empty_mass_kg,
        body.empty_mass_u_kg or 0.0,
        undetectable_changes(nuisances, shared_errors),
    )
