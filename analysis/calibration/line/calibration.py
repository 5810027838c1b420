"""A calibration as it is stored, in plain finite numbers, and the masses that it gives later."""

import json
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from pydantic import ConfigDict, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass

from analysis.calibration.line.line_inversion import LineInversion
from analysis.calibration.line.line_limits import LIMITS
from analysis.calibration.line.line_model import DAY
from analysis.model.prior_settings import LearnableTerm
from estimators.errors import DataError

_CONFIG: Final = ConfigDict(extra="forbid", allow_inf_nan=False, strict=True)


@dataclass(frozen=True, slots=True, config=_CONFIG)
class StatedPart:
    """A component of the budget that the points do not show.

    Attributes:
        component: its name.
        u_kg: standard uncertainty in kg of m̂; None where it is not known.
        absorbed: true for a constant of the machine, which the line takes with it as long as it
            stays as it was at the calibration; false for what later masses have anew.
        known: how it is known.
    """

    component: str
    u_kg: float | None
    absorbed: bool
    known: str


@dataclass(frozen=True, slots=True, config=_CONFIG)
class CalibrationOptions:
    """Options of a calibration.

    Attributes:
        method: name of the estimator that gives m̂.
        confidence_1: of every interval.
        day_known_kg: deviation from day to day where it is known, in kg of m̂.
        margin_1: how far beyond its references a calibration holds, as a share of their range.
        stated: components of the budget that the points do not show.
    """

    method: str
    confidence_1: float = 0.95
    day_known_kg: float | None = None
    margin_1: float = 0.0
    stated: tuple[StatedPart, ...] = ()


@dataclass(frozen=True, slots=True, config=_CONFIG)
class Component:
    """A source of scatter or of the line's uncertainty.

    Attributes:
        name: of it.
        variance_kg2: of one draw of it, in kg² of m̂; 1 for the references, whose size is in
            `on_line`.
        freedom: degrees of freedom of that; None where it is known.
        on_line: what a variance of 1 gives: variance of the level, covariance of level and slope,
            variance of the slope.
        estimated: whether its variance has a row in `variance_covariance`, in this order.
        scatters: whether a later mass has it anew.
    """

    name: str
    variance_kg2: float
    freedom: float | None
    on_line: tuple[float, float, float]
    estimated: bool
    scatters: bool

    @property
    def std_kg(self) -> float:
        """Standard deviation of one draw, in kg of m̂."""
        return max(self.variance_kg2, 0.0) ** 0.5


@dataclass(frozen=True, slots=True, config=_CONFIG)
class Point:
    """One run: the mean of its readings, and how the line meets it.

    Errors are calibrated less reference, in kg; None for a run without a used reading, or where
    the loads left determine no line.
    """

    run_id: str
    load_id: str
    day: str
    reference_kg: float
    readings: int
    rejected: int
    mean_kg: float | None
    std_kg: float | None
    calibrated_kg: float | None
    error_kg: float | None
    error_left_out_kg: float | None
    studentised_1: float | None


@dataclass(frozen=True, slots=True, config=_CONFIG)
class Reference:
    """Known mass on board: a load, plus the machine if its mass is a reference."""

    load_id: str
    reference_kg: float


@dataclass(frozen=True, slots=True, config=_CONFIG)
class LackOfFit:
    """F test of the loads' means about the line.

    Attributes:
        F_1: the ratio, or None where nothing tells.
        p_1: of a ratio as large where the line is right.
        freedom: of numerator and denominator.
        against: the scatter that it is compared with.
        separate: whether a load's deviation from the line can be told from that of a run.
    """

    F_1: float | None
    p_1: float | None
    freedom: tuple[int, int] | None
    against: str
    separate: bool


@dataclass(frozen=True, slots=True, config=_CONFIG)
class Outlier:
    """A value that a test finds unlikely; it stays in the fit.

    Attributes:
        test: its name.
        about: which run, and which reading of it.
        value_1: of the test's statistic.
        p_1: of one as large, the number of values that could be it taken into account.
    """

    test: str
    about: str
    value_1: float
    p_1: float


@dataclass(frozen=True, slots=True, config=_CONFIG)
class LineResponse:
    """What one standard uncertainty of a learnt mean moved the line by.

    Attributes:
        term: whose mean it is.
        level_kg: at the line's centre.
        slope_1: for each kg of the reference.
    """

    term: LearnableTerm
    level_kg: float
    slope_1: float


@dataclass(frozen=True, slots=True, config=_CONFIG)
class BudgetRow:
    """A row of the uncertainty budget at the heavy end of the valid range.

    Attributes:
        component: its name.
        kind: "random" (anew in every run), "day" (anew every day), "line" (the same in every later
            mass), "stated" or "absorbed" (gone with the calibration).
        u_kg: contribution to the calibrated mass of one reading, as a standard uncertainty; None
            where it is not known.
        freedom: degrees of freedom; None where it is known rather than estimated.
        known: how it is known.
    """

    component: str
    kind: str
    u_kg: float | None
    freedom: float | None
    known: str


@dataclass(frozen=True, slots=True, config=_CONFIG)
class CalibratedMass:
    """A calibrated mass with its interval; None with the reason if there is none."""

    mass_kg: float | None
    u_kg: float | None
    low_kg: float | None
    high_kg: float | None
    reason: str


@dataclass(frozen=True, slots=True, config=_CONFIG)
class Calibration:
    """The line m̂ = c0 + c1 m, its inverse, and everything that a later mass needs of it.

    Masses of `repeatability_kg`, `run_kg`, `day_kg` are deviations in kg of m̂; over |c1| they are
    kg of mass, as the budget has them.
    """

    method: str
    confidence_1: float
    alpha_1: float
    alpha_interval_1: tuple[float | None, float | None]
    beta_kg: float
    beta_interval_kg: tuple[float | None, float | None]
    c0_kg: float
    c1_1: float
    covariance: tuple[float, float, float]
    centre_kg: float
    level_kg: float
    chi2_1: float
    freedom: int
    repeatability_kg: float | None
    repeatability_freedom: int
    run_kg: float | None
    run_freedom: int
    day_kg: float | None
    day_freedom: int | None
    components: tuple[Component, ...]
    few_days: int | None
    most_readings: int
    variance_covariance: tuple[tuple[float, ...], ...]
    stated: tuple[StatedPart, ...]
    common_kg: float
    common_counts: bool
    lack_of_fit: LackOfFit
    references: tuple[Reference, ...]
    references_covariance_kg2: tuple[tuple[float, ...], ...]
    points: tuple[Point, ...]
    outliers: tuple[Outlier, ...]
    rms_error_kg: float
    rms_error_left_out_kg: float | None
    attenuation_1: float | None
    stated_ratio_1: float | None
    range_kg: tuple[float, float]
    budget: tuple[BudgetRow, ...]
    budget_at: tuple[float, int]
    coverage_k_1: float
    u_kg: float
    says: tuple[str, ...]
    responses: tuple[LineResponse, ...] = ()

    @property
    def has_runs_of_one_day_only(self) -> bool:
        """Whether all runs are of one day, so that the scatter between days is unknown."""
        return self.day_count_with_unknown_scatter == 1

    @property
    def day_count_with_unknown_scatter(self) -> int:
        """Number of days with runs if it is too small to estimate scatter between days; else 0."""
        if self.day_kg is not None and self.day_freedom is None:
            return 0
        days = len({point.day for point in self.points if point.readings})
        return days if days < LIMITS.enough_days else 0

    @property
    def inversion(self) -> LineInversion:
        """Make the inverse of the line, which turns a later m̂ into a mass."""
        parts = self.components
        return LineInversion(
            centre_kg=self.centre_kg,
            level_kg=self.level_kg,
            slope_1=self.c1_1,
            effects={part.name: k for k, part in enumerate(parts)},
            variance_kg2=np.array([part.variance_kg2 for part in parts]),
            on_line=np.array([[part.on_line[:2], part.on_line[1:]] for part in parts]),
            scatters=np.array([float(part.scatters) for part in parts]),
            estimated=np.flatnonzero([part.estimated for part in parts]).astype(np.int64),
            covariance=np.array(self.variance_covariance),
            extra_kg2=sum_variance_not_in_scatter_of_points_kg2(
                self.stated, self.common_kg if self.common_counts else 0.0
            ),
            degrees_of_freedom_by_scarce_effect={}
            if self.few_days is None
            else {DAY: self.few_days},
            most_readings=self.most_readings,
        )

    def calibrate_estimate(
        self,
        mass_kg: float | None,
        u_random_kg: float | None,
        reading_count: int,
        driving_u_kg: float = 0.0,
    ) -> CalibratedMass:
        """The calibrated mass of a later m̂, with its interval.

        Args:
            mass_kg: m̂ of a load, by the same method.
            u_random_kg: random part of its standard uncertainty, in kg of m̂; None if unknown: then
                that of the campaign's readings is used.
            reading_count: number of readings in the mean m̂.
            driving_u_kg: uncertainty by errors in its log that the line does not absorb, in kg.

        Returns:
            The mass, or None with the reason: no estimate, a slope that cannot be distinguished
            from 0, or an interval that is wider than the valid range or lies outside of it.
        """
        if mass_kg is None or not np.isfinite(mass_kg) or reading_count < 1:
            return _make_withheld_mass("no estimate")
        found = self.inversion.copy_with_common_uncertainty(
            driving_u_kg / abs(self.c1_1)
        ).invert_mass_estimates(
            np.array([mass_kg]),
            np.array([float(reading_count)]),
            np.array([np.nan if u_random_kg is None else u_random_kg]),
            self.confidence_1,
        )
        mass, u, low, high = (
            float(x[0]) for x in (found.mass_kg, found.u_kg, found.low_kg, found.high_kg)
        )
        if not np.isfinite([low, high]).all():
            return _make_withheld_mass("the calibration's slope cannot be told from 0")
        least, most = self.range_kg
        half = (high - low) / 2.0
        if half > most - least:
            return _make_withheld_mass(
                f"± {half:.3g} kg is more than the calibrated range, {least:.6g} to {most:.6g} kg"
            )
        if high < least or low > most:
            return _make_withheld_mass(
                f"{mass:.6g} kg is outside of the calibrated range, {least:.6g} to {most:.6g} kg"
            )
        return CalibratedMass(mass, u, low, high, "")

    def to_dict(self) -> dict[str, Any]:
        """The fields as plain JSON values, without NaN or infinity."""
        return _ADAPTER.dump_python(self, mode="json")

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> "Calibration":
        """Make a calibration from the values of `to_dict`.

        Raises:
            DataError: the values are not those of a calibration.
        """
        try:
            return _ADAPTER.validate_json(json.dumps(values))
        except (ValidationError, TypeError, ValueError) as error:
            first = error.errors()[0] if isinstance(error, ValidationError) else None
            where = ".".join(map(str, first["loc"])) if first else ""
            what = first["msg"] if first else str(error)
            raise DataError(f"calibration: {where}: {what}") from error


def sum_variance_not_in_scatter_of_points_kg2(
    stated_parts: tuple[StatedPart, ...], common_u_kg: float
) -> float:
    """Variance of a later m̂ that the scatter of the points does not contain, in kg²."""
    anew = (one.u_kg for one in stated_parts if not one.absorbed and one.u_kg is not None)
    return common_u_kg**2 + sum(u_kg**2 for u_kg in anew)


def _make_withheld_mass(reason: str) -> CalibratedMass:
    return CalibratedMass(None, None, None, None, reason)


_ADAPTER: Final = TypeAdapter(Calibration)
