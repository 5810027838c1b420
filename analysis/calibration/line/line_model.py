"""Model of a calibration line, with every effect that scatters its points."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from analysis.calibration.line.distance_regression import fit_line_by_generalised_distance
from analysis.calibration.line.line_limits import LIMITS
from analysis.calibration.line.variance_components import (
    Variances,
    WithinRunVariance,
    estimate_variances_by_reml,
)
from estimators.arrays import Floats, Ints

#: The effects that scatter points, in their order.
REPEATABILITY: Final = "repeatability"
RUN: Final = "run to run"
DAY: Final = "day to day"
LACK_OF_FIT: Final = "lack of fit"
#: Effect of errors of the references, which later masses do not draw again.
REFERENCES: Final = "references"


@dataclass(frozen=True, eq=False)
class RunMeans:
    """Mean readings of the runs, with their reference masses.

    Attributes:
        y_kg: (points,) mean of a run's readings.
        readings: (points,) number of readings in each mean.
        load: (points,) index of the load.
        day: (points,) index of the day.
        reference_kg: (loads,) reference masses.
        covariance_kg2: (loads, loads) covariance of the references.
        within: scatter of the readings about their means.
    """

    y_kg: Floats
    readings: Ints
    load: Ints
    day: Ints
    reference_kg: Floats
    covariance_kg2: Floats
    within: WithinRunVariance

    @property
    def x_kg(self) -> Floats:
        """(points,) reference mass of each point."""
        return self.reference_kg[self.load]

    @property
    def x_cov_kg2(self) -> Floats:
        """(points, points) covariance of `x_kg`: runs with one load share the error of its mass."""
        return self.covariance_kg2[np.ix_(self.load, self.load)]

    @property
    def day_count(self) -> int:
        """Number of days."""
        return np.unique(self.day).size

    def make_effect_covariance(self, effect_name: str) -> Floats:
        """(points, points) covariance of the points for a unit variance of an effect."""
        if effect_name == REPEATABILITY:
            return np.diag(1.0 / self.readings)
        if effect_name == RUN:
            return np.eye(self.y_kg.size)
        of = self.day if effect_name == DAY else self.load
        return (of[:, None] == of[None, :]).astype(np.float64)


@dataclass(frozen=True, eq=False)
class Effect:
    """One effect that scatters points.

    Attributes:
        name: name of the effect.
        variance_kg2: variance of one draw; negative if its mean square is smaller than the other
            effects alone explain.
        on_line: (2, 2) covariance of level and slope for a variance of 1.
        estimated: whether its variance is among `FittedLine.variances`, in the same order.
        scatters: whether a later run draws it again: all except the references and the common
            error.
    """

    name: str
    variance_kg2: float
    on_line: Floats
    estimated: bool
    scatters: bool = True


@dataclass(frozen=True, eq=False)
class FittedLine:
    """A line y = level + slope (x - centre), with the effects behind its uncertainty."""

    centre_kg: float
    level_kg: float
    slope_1: float
    effects: tuple[Effect, ...]
    variances: Variances
    chi2: float
    degrees_of_freedom: int
    residual_kg: Floats
    point_covariance_kg2: Floats
    adjusted_kg: Floats
    day_degrees_of_freedom: int | None
    most_readings: int


def choose_estimable_random_effects(
    points: RunMeans, parameter_count: int, *, is_day_variance_known: bool
) -> tuple[str, ...]:
    """Effects whose variances the points determine, given the number of fitted parameters.

    Days are separated from runs if there are several days, several runs in one of them, and enough
    points for both; otherwise the scatter of runs includes that of days.
    """
    names: list[str] = []
    count, days = points.y_kg.size, points.day_count
    if points.within.degrees_of_freedom:
        names.append(REPEATABILITY)
    if count > parameter_count:
        names.append(RUN)
        if (
            1 < days < count
            and not is_day_variance_known
            and count - parameter_count - (days - 1) > 0
        ):
            names.append(DAY)
    return tuple(names)


def make_mean_square_to_variance_matrix(points: RunMeans, effect_names: tuple[str, ...]) -> Floats:
    """(effects, effects) matrix from mean squares, which cannot be negative, to variances.

    By chance, run means may scatter less than their readings imply; the variance between runs is
    then negative. Set to 0, it would have few degrees of freedom, whose Student factor would widen
    every interval.
    The mean squares of a run's mean, with the largest number of readings, and of a day's mean stay
    positive.
    """
    of = np.eye(len(effect_names))
    if REPEATABILITY in effect_names and RUN in effect_names:
        of[effect_names.index(RUN), effect_names.index(REPEATABILITY)] = (
            -1.0 / points.readings.max()
        )
    if DAY in effect_names:
        most = np.bincount(points.day).max()
        of[effect_names.index(DAY), effect_names.index(RUN)] = -1.0 / most
    return of


@dataclass(frozen=True, eq=False)
class CovarianceStructure:
    """Covariance of a campaign's points, by effect.

    Attributes:
        names: (effects,) names of the estimated effects.
        each: (effects, points, points) covariance for a unit variance of each.
        squares: (effects, effects) matrix of `make_mean_square_to_variance_matrix`.
        day: (points, points) covariance for a unit variance of the day.
        day_known_kg: known standard deviation between days; None if unknown.
        known_covariance: (points, points) known covariance.
    """

    names: tuple[str, ...]
    each: Floats
    squares: Floats
    day: Floats
    day_known_kg: float | None
    known_covariance: Floats

    @property
    def mean_square_covariances(self) -> Floats:
        """(effects, points, points) covariance of the points for a unit mean square of each."""
        return np.asarray(np.tensordot(self.squares.T, self.each, 1), np.float64)

    def combine_effect_covariances(self, variances: Floats) -> Floats:
        """(points, points) covariance for the given variances."""
        return np.asarray(np.tensordot(variances, self.each, 1) + self.known_covariance, np.float64)

    def describe_effects_on_line(
        self, variances: Variances, design: Floats, slope: float, x_cov: Floats
    ) -> tuple[Effect, ...]:
        """Each effect, with its contribution to a line fitted by generalised least squares."""
        covariance = self.combine_effect_covariances(variances.value) + slope**2 * x_cov
        weighted = np.linalg.solve(covariance, design).T
        # (2, points): derivatives of level and slope by each point
        gain = np.linalg.solve(weighted @ design, weighted)
        effects = [
            Effect(name, float(variance), gain @ one @ gain.T, estimated=True)
            for name, variance, one in zip(self.names, variances.value, self.each, strict=True)
        ]
        if self.day_known_kg is not None:
            through = gain @ self.day @ gain.T
            effects.append(Effect(DAY, self.day_known_kg**2, through, estimated=False))
        through = slope**2 * gain @ x_cov @ gain.T
        return (*effects, Effect(REFERENCES, 1.0, through, estimated=False, scatters=False))


def make_covariance_structure(
    points: RunMeans, effect_names: tuple[str, ...], known_day_std_kg: float | None
) -> CovarianceStructure:
    """Covariance structure of the points for these effects."""
    day = points.make_effect_covariance(DAY)
    known = (
        np.eye(points.y_kg.size) * (LIMITS.rounding_mass_fraction * np.abs(points.y_kg).max()) ** 2
    )
    if known_day_std_kg is not None:
        known = known + known_day_std_kg**2 * day
    each = np.array([points.make_effect_covariance(name) for name in effect_names])
    return CovarianceStructure(
        effect_names,
        each,
        make_mean_square_to_variance_matrix(points, effect_names),
        day,
        known_day_std_kg,
        known,
    )


def fit_line_and_variances(
    points: RunMeans, *, known_day_std_kg: float | None = None, has_lack_of_fit: bool = False
) -> FittedLine:
    """Fit line and variances together.

    Args:
        points: means of runs.
        known_day_std_kg: known standard deviation between days, in kg of m̂; None if unknown.
        has_lack_of_fit: whether each load has its own deviation from the line.
    """
    names = choose_estimable_random_effects(
        points, 2, is_day_variance_known=known_day_std_kg is not None
    )
    scatter = make_covariance_structure(
        points, (*names, LACK_OF_FIT) if has_lack_of_fit else names, known_day_std_kg
    )
    by_squares = scatter.mean_square_covariances
    x, y, x_cov = points.x_kg, points.y_kg, points.x_cov_kg2
    centre_kg = float(x.mean())
    slope = float(np.polyfit(x - centre_kg, y, 1)[0])
    design = np.column_stack([np.ones_like(x), x - centre_kg])
    residual = y
    rounds, start = 0, None
    while True:
        found = estimate_variances_by_reml(
            residual,
            design,
            by_squares,
            scatter.known_covariance + slope**2 * x_cov,
            points.within,
            start,
        )
        start, variances = found.value, found.propagate_to_linear_combinations(scatter.squares)
        line = fit_line_by_generalised_distance(
            x - centre_kg, y, x_cov, scatter.combine_effect_covariances(variances.value)
        )
        moved, slope = abs(line.slope - slope), line.slope
        design = np.column_stack([np.ones_like(x), line.x])
        residual = line.residual
        rounds += 1
        settled = moved <= LIMITS.line_step_std * np.sqrt(line.covariance[1, 1])
        if settled or rounds == LIMITS.line_max_rounds or not x_cov.any():
            break
    return FittedLine(
        centre_kg=centre_kg,
        level_kg=line.intercept,
        slope_1=slope,
        effects=scatter.describe_effects_on_line(variances, design, slope, x_cov),
        variances=variances,
        chi2=line.chi2,
        degrees_of_freedom=line.degrees_of_freedom,
        residual_kg=line.residual,
        point_covariance_kg2=scatter.combine_effect_covariances(variances.value) + slope**2 * x_cov,
        adjusted_kg=line.x + centre_kg,
        day_degrees_of_freedom=points.day_count - 1
        if DAY in names and points.day_count < LIMITS.enough_days
        else None,
        most_readings=int(points.readings.max()),
    )
