"""Facts about a later log that decide whether a calibration applies."""

from collections.abc import Mapping
from typing import Final

import polars as pl

from analysis.calibration.line.shared_errors import SharedErrors
from analysis.calibration.use.apply_calibration import LaterLog
from analysis.calibration.use.learnt_priors import (
    describe_contradicted_priors,
    describe_undetectable_changes,
)
from analysis.model.machine_body import Body

#: What it takes of a replay; the last two a replay under learnt priors has.
FRAMES: Final = ("loads", "nuisances", "responses", "learnt_errors")


def describe_later_log(
    frames: Mapping[str, pl.DataFrame], body: Body, refused: str = ""
) -> LaterLog:
    """Collect the facts about a later log.

    Args:
        frames: `FRAMES` of a replay with the calibration's learnt priors.
        body: machine body with the calibration's empty mass.
        refused: known reason why the log must not be calibrated, if any.
    """
    nuisances, shared_errors = frames["nuisances"], SharedErrors.from_frames(frames)
    return LaterLog(
        refused or describe_contradicted_priors(nuisances),
        shared_errors,
        body.empty_mass_kg,
        body.empty_mass_u_kg or 0.0,
        describe_undetectable_changes(nuisances, shared_errors),
    )
