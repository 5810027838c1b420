"""Errors that a log shares with its calibration through learnt priors.

The means of learnt priors have errors ε, in units of their standard uncertainties. These shifted
the campaign's points by R(m) ε, which the line contains; they shift a later mass by r ε. The
remaining error is (r - R(m)) ε, which vanishes if the log is driven like its campaign. The later
log and the calibration together estimate ε.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
import polars as pl
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from analysis.calibration.line.calibration import LineResponse
from analysis.model.prior_settings import LearnableTerm
from analysis.model.schema import SCALE
from estimators.arrays import Floats


class RunResponse(BaseModel):
    """What one standard uncertainty of a learnt mean moves the estimate of a run by."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    run_id: str = Field(max_length=200)
    term: LearnableTerm
    response_kg: float


def compute_line_changes_per_learnt_mean_u(
    run_responses: Sequence[RunResponse], reference_kg: Mapping[str, float], centre_kg: float
) -> tuple[LineResponse, ...]:
    """Responses of a line's level and slope to errors of learnt means.

    Args:
        run_responses: responses by run and term; runs without a point are ignored.
        reference_kg: reference of each run with a point.
        centre_kg: mass at which the line has its level.
    """
    found: list[LineResponse] = []
    by_term: dict[LearnableTerm, list[RunResponse]] = {}
    for each in run_responses:
        if each.run_id in reference_kg:
            by_term.setdefault(each.term, []).append(each)
    for term, own in sorted(by_term.items()):
        away = np.array([reference_kg[each.run_id] - centre_kg for each in own])
        if np.ptp(away) == 0.0:
            continue
        columns = np.column_stack([np.ones(away.size), away])
        moved_kg = np.array([each.response_kg for each in own])
        level, slope = np.linalg.lstsq(columns, moved_kg, rcond=None)[0].tolist()
        found.append(LineResponse(term, level, slope))
    return tuple(found)


@dataclass(frozen=True)
class SharedErrors:
    """A log's estimate of the errors that it shares with its calibration.

    Attributes:
        terms: terms with learnt means.
        error_1: (terms,) errors of the means, in their standard uncertainties.
        covariance_1: (terms, terms) covariance of the errors.
        is_corrected: (terms,) whether the log's masses are already corrected for the error.
        mass_responses_kg: (terms,) responses of each mass or payload, by its kind (`MASS_KINDS`)
            and number.
        scale_kg: uncertainty due to the scale, by the same keys.
    """

    terms: tuple[LearnableTerm, ...]
    error_1: Floats
    covariance_1: Floats
    is_corrected: NDArray[np.bool_]
    mass_responses_kg: Mapping[tuple[str, int], Floats]
    scale_kg: Mapping[tuple[str, int], float]

    @classmethod
    def from_frames(cls, frames: Mapping[str, pl.DataFrame]) -> Self | None:
        """Read the estimate from a replay's frames; None without learnt priors."""
        if "responses" not in frames:
            return None
        known, moved = frames["learnt_errors"], frames["responses"]
        terms = tuple(known["term"].unique(maintain_order=True))
        place = {term: k for k, term in enumerate(terms)}
        covariance = np.eye(len(terms))
        error, is_corrected = np.zeros(len(terms)), np.zeros(len(terms), np.bool_)
        for term, other, error_1, covariance_1, is_term_corrected in known.iter_rows():
            error[place[term]], is_corrected[place[term]] = error_1, is_term_corrected
            covariance[place[term], place[other]] = covariance_1
        mass_responses_kg: dict[tuple[str, int], Floats] = {}
        scale_kg: dict[tuple[str, int], float] = {}
        for of, number, term, response_kg in moved.iter_rows():
            if term == SCALE:
                scale_kg[of, number] = response_kg
            else:
                own = mass_responses_kg.setdefault((of, number), np.zeros(len(terms)))
                own[place[term]] = response_kg
        return cls(terms, error, covariance, is_corrected, mass_responses_kg, scale_kg)

    def compute_line_shifts_kg(
        self,
        responses: Sequence[LineResponse],
        level_response_1: float,
        distance_from_centre_kg: float,
    ) -> Floats:
        """(terms,) shifts of the line by one unit of each error.

        Args:
            responses: responses of the line.
            level_response_1: factor of the line's level: 1 for a mass, 0 for a difference of two.
            distance_from_centre_kg: distance from the line's centre.
        """
        by_term = {each.term: each for each in responses}
        return np.array(
            [
                by_term[term].level_kg * level_response_1
                + by_term[term].slope_1 * distance_from_centre_kg
                if term in by_term
                else 0.0
                for term in self.terms
            ]
        )

    def compute_offset_from_line_kg_and_u_kg(
        self, responses_kg: Floats, line_shifts_kg: Floats
    ) -> tuple[float, float]:
        """Offset of an estimate from the line, and its standard uncertainty, in kg of m̂.

        Args:
            responses_kg: (terms,) responses of the estimate.
            line_shifts_kg: (terms,) shifts of the line.
        """
        left = np.where(self.is_corrected, 0.0, responses_kg) - line_shifts_kg
        return float(left @ self.error_1), self.compute_shared_error_u_kg(
            responses_kg - line_shifts_kg
        )

    def compute_shared_error_u_kg(self, mass_responses_kg: Floats) -> float:
        """Standard uncertainty of an estimate due to the shared errors, in kg of m̂."""
        return float(
            np.sqrt(max(float(mass_responses_kg @ self.covariance_1 @ mass_responses_kg), 0.0))
        )

    def compute_shared_part_of_log_u_kg(self, responses_kg: Floats) -> float:
        """Part of the log's own standard uncertainty due to the shared errors, in kg of m̂."""
        corrected_kg = np.where(self.is_corrected, responses_kg, 0.0)
        return float(
            np.hypot(
                self.compute_shared_error_u_kg(corrected_kg),
                np.linalg.norm(responses_kg - corrected_kg),
            )
        )
