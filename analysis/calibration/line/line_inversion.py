"""Inverse of the calibration line, with Fieller's interval."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.optimize import brentq
from scipy.special import ndtri, stdtrit

from analysis.calibration.line.line_limits import LIMITS
from analysis.calibration.line.line_model import DAY, REPEATABILITY, RUN, FittedLine
from analysis.calibration.line.variance_components import Variances
from estimators.arrays import Floats, Ints

_UNBOUNDED: Final = float("nan")


@dataclass(frozen=True, eq=False)
class InverseReading:
    """Masses, uncertainties and intervals, (n,) each; limits are NaN if the slope may be 0."""

    mass_kg: Floats
    u_kg: Floats
    low_kg: Floats
    high_kg: Floats
    factor_1: Floats


@dataclass(frozen=True, eq=False)
class LineInversion:
    """A line y = level + slope (x - centre) with the scatter of later values of y.

    Attributes:
        centre_kg: mass at which the line has its level.
        level_kg: level of the line.
        slope_1: slope of the line.
        effects: index of each effect by name.
        variance_kg2: (effects,) variance of one draw.
        on_line: (effects, 2, 2) covariance of level and slope for a variance of 1.
        scatters: (effects,) whether a later value draws the effect again.
        estimated: (estimated,) indices of the effects whose variances are estimated.
        covariance: (estimated, estimated) covariance of the estimated variances.
        extra_kg2: variance of every later value that the points do not show.
        degrees_of_freedom_by_scarce_effect: degrees of freedom of the effects that have few, by
            name. Each has its own Student factor: the single factor of Welch and Satterthwaite
            relies on an estimate of one or two degrees of freedom when it is small by chance.
        most_readings: largest number of readings of a run of the campaign.
    """

    centre_kg: float
    level_kg: float
    slope_1: float
    effects: Mapping[str, int]
    variance_kg2: Floats
    on_line: Floats
    scatters: Floats
    estimated: Ints
    covariance: Floats
    extra_kg2: float
    degrees_of_freedom_by_scarce_effect: Mapping[str, int]
    most_readings: int

    @classmethod
    def from_line(cls, line: FittedLine, unobserved_variance_kg2: float = 0.0) -> "LineInversion":
        """Inverse of a fitted line."""
        effects = line.effects
        return cls(
            centre_kg=line.centre_kg,
            level_kg=line.level_kg,
            slope_1=line.slope_1,
            effects={effect.name: k for k, effect in enumerate(effects)},
            variance_kg2=np.array([effect.variance_kg2 for effect in effects]),
            on_line=np.array([effect.on_line for effect in effects]),
            scatters=np.array([float(effect.scatters) for effect in effects]),
            estimated=np.flatnonzero([effect.estimated for effect in effects]).astype(np.int64),
            covariance=line.variances.covariance,
            extra_kg2=unobserved_variance_kg2,
            degrees_of_freedom_by_scarce_effect={}
            if line.day_degrees_of_freedom is None
            else {DAY: line.day_degrees_of_freedom},
            most_readings=line.most_readings,
        )

    def invert_mass_estimates(
        self, y_kg: Floats, reading_counts: Floats, u_random_kg: Floats, confidence_1: float
    ) -> InverseReading:
        """Mass of each later m̂, with its interval.

        The random variance is that of the campaign for this number of readings, or that of the
        value itself if larger. The Student factor is that of Welch and Satterthwaite, except for
        effects with few degrees of freedom.

        Args:
            y_kg: (n,) later values of m̂.
            reading_counts: (n,) number of readings in each value.
            u_random_kg: (n,) random standard uncertainty of each value, in kg; NaN if unknown.
            confidence_1: confidence of the intervals.

        Source:
            Fieller (1954); Draper and Smith, Applied Regression Analysis, 3.2 (inverse regression).
        """
        new = self._make_effect_factors_of_later_value(reading_counts)
        beyond = self._compute_random_variance_beyond_campaign_kg2(new, u_random_kg)
        return self._invert_with_effect_factors(y_kg, new, beyond + self.extra_kg2, confidence_1)

    def invert_with_line_uncertainty_only(self, y_kg: float, confidence_1: float) -> InverseReading:
        """Mass whose value on the line is `y_kg`, with the interval of the line alone.

        Args:
            y_kg: value on the line.
            confidence_1: confidence of the interval, 0 to 1.
        """
        none = np.zeros((1, self.variance_kg2.size))
        return self._invert_with_effect_factors(np.array([y_kg]), none, np.zeros(1), confidence_1)

    def compute_slope_interval(self, confidence_1: float) -> tuple[float, float]:
        """Confidence interval of the slope."""
        gradient = self.on_line[None, :, 1, 1]
        squared, _ = self._compute_squared_student_factors(gradient, np.zeros(1), confidence_1)
        half = float(np.sqrt((squared * gradient) @ self.variance_kg2)[0])
        return self.slope_1 - half, self.slope_1 + half

    def compute_later_mass_variance_by_effect_kg2(self, reading_count: float) -> Floats:
        """(effects,) variance of a later mass by a new draw of each effect, in kg² of mass."""
        return (
            self._make_effect_factors_of_later_value(np.array([reading_count]))[0]
            * self.variance_kg2
            / self.slope_1**2
        )

    def copy_with_common_uncertainty(self, u_kg: float) -> "LineInversion":
        """Copy with an additional uncertainty common to all later masses, in kg of mass."""
        return replace(self, extra_kg2=self.extra_kg2 + (u_kg * self.slope_1) ** 2)

    def compute_later_mass_u_kg(
        self, mass_kg: float, reading_count: float, u_random_kg: float = 0.0
    ) -> float:
        """Standard uncertainty of a later mass, in kg."""
        return self._compute_half_interval_or_u_kg(mass_kg, None, reading_count, u_random_kg)

    def compute_half_interval_kg(
        self, mass_kg: float, confidence_1: float, reading_count: float, u_random_kg: float = 0.0
    ) -> float:
        """Half-width in kg of the interval of a mass weighed after the campaign.

        The asymmetry by the uncertainty of the slope is neglected.

        Args:
            mass_kg: calibrated mass.
            confidence_1: confidence of the interval.
            reading_count: number of readings in the mean.
            u_random_kg: random standard uncertainty of the mean in kg of m̂; 0 if unknown.
        """
        return self._compute_half_interval_or_u_kg(
            mass_kg, confidence_1, reading_count, u_random_kg
        )

    def compute_exceedance_probability(
        self, distance_kg: float, mass_kg: float, reading_count: float, u_random_kg: float = 0.0
    ) -> float:
        """Probability that a later mass errs to one side by more than `distance_kg`; 0.5 at 0."""
        if distance_kg < 0.0:
            return 1.0 - self.compute_exceedance_probability(
                -distance_kg, mass_kg, reading_count, u_random_kg
            )

        def compute_half_interval_excess_kg(tail: float) -> float:
            confidence_1 = 1.0 - 2.0 * tail
            return (
                self.compute_half_interval_kg(mass_kg, confidence_1, reading_count, u_random_kg)
                - distance_kg
            )

        if compute_half_interval_excess_kg(LIMITS.min_tail_probability) <= 0.0:
            return LIMITS.min_tail_probability
        return (
            float(
                brentq(
                    compute_half_interval_excess_kg, LIMITS.min_tail_probability, 0.5, xtol=1e-12
                )
            )
            if distance_kg
            else 0.5
        )

    def _compute_half_interval_or_u_kg(
        self, mass_kg: float, confidence_1: float | None, reading_count: float, u_random_kg: float
    ) -> float:
        """Half-width of the interval in kg; the standard uncertainty if no confidence is given."""
        away = np.array([1.0, mass_kg - self.centre_kg])
        new = self._make_effect_factors_of_later_value(np.array([reading_count]))
        gradient = new + np.einsum("i,kij,j->k", away, self.on_line, away)
        more_kg2 = (
            self._compute_random_variance_beyond_campaign_kg2(new, np.array([u_random_kg]))
            + self.extra_kg2
        )
        scaled, of_more = gradient, 1.0
        if confidence_1 is not None:
            squared, of_rest = self._compute_squared_student_factors(
                gradient, more_kg2, confidence_1
            )
            scaled, of_more = squared * gradient, float(of_rest[0])
        variance = float((scaled @ self.variance_kg2)[0]) + of_more * float(more_kg2[0])
        return float(np.sqrt(variance)) / abs(self.slope_1)

    def _compute_random_variance_beyond_campaign_kg2(
        self, effect_factors: Floats, u_random_kg: Floats
    ) -> Floats:
        """Random variance of later values beyond that of the campaign's readings, (n,)."""
        random = (
            effect_factors[:, self._find_index_of_random_effect()]
            * self.variance_kg2[self._find_index_of_random_effect()]
        )
        return np.fmax(np.nan_to_num(u_random_kg) ** 2 - np.maximum(random, 0.0), 0.0)

    def _find_index_of_random_effect(self) -> int:
        """Index of the effect that averages out over readings, or of the one that contains it."""
        return self.effects.get(REPEATABILITY, self.effects.get(RUN, 0))

    def _make_effect_factors_of_later_value(self, reading_counts: Floats) -> Floats:
        """Factor of each variance component in the variance of a later value, (n, effects)."""
        new = np.tile(self.scatters, (reading_counts.size, 1))
        if self.variance_kg2[self.effects.get(RUN, 0)] < 0.0:
            # the campaign does not show the scatter of means over more readings than its runs have
            reading_counts = np.minimum(reading_counts, self.most_readings)
        if REPEATABILITY in self.effects:
            new[:, self.effects[REPEATABILITY]] /= reading_counts
        return new

    def _invert_with_effect_factors(
        self,
        y_kg: Floats,
        effect_factors: Floats,
        additional_variance_kg2: Floats,
        confidence_1: float,
    ) -> InverseReading:
        """Mass, uncertainty and interval of later values, given the factor of each effect."""
        away = (y_kg - self.level_kg) / self.slope_1
        at = np.stack([np.ones_like(away), away], -1)
        gradient = effect_factors + np.einsum("ni,kij,nj->nk", at, self.on_line, at)
        u_kg = np.sqrt(gradient @ self.variance_kg2 + additional_variance_kg2) / abs(self.slope_1)
        squared, of_more = self._compute_squared_student_factors(
            gradient, additional_variance_kg2, confidence_1
        )
        # (d - s h)² = Σ t² (own + v00 + 2 h v01 + h² v11), for h from the centre
        scaled = squared * self.variance_kg2
        line = np.einsum("nk,kij->nij", scaled, self.on_line)
        own = (scaled * effect_factors).sum(axis=1) + of_more * additional_variance_kg2
        d = y_kg - self.level_kg
        a = self.slope_1**2 - line[:, 1, 1]
        b = d * self.slope_1 + line[:, 0, 1]
        c = d**2 - own - line[:, 0, 0]
        bounded = a > 0.0
        a = np.where(bounded, a, 1.0)
        half = np.sqrt(np.maximum(b**2 - a * c, 0.0)) / a
        return InverseReading(
            mass_kg=self.centre_kg + away,
            u_kg=u_kg,
            low_kg=np.where(bounded, self.centre_kg + b / a - half, _UNBOUNDED),
            high_kg=np.where(bounded, self.centre_kg + b / a + half, _UNBOUNDED),
            factor_1=np.where(bounded, half / u_kg, _UNBOUNDED),
        )

    def _compute_squared_student_factors(
        self, gradient: Floats, additional_variance_kg2: Floats, confidence_1: float
    ) -> tuple[Floats, Floats]:
        """Squared Student factors of each effect, (n, effects), and of the rest, (n,).

        Args:
            gradient: (n, effects) derivatives with respect to the variances.
            additional_variance_kg2: (n,) known part of the variance.
            confidence_1: confidence of the intervals.
        """
        rest = gradient.copy()
        squared = np.zeros_like(gradient)
        for name, degrees_of_freedom in self.degrees_of_freedom_by_scarce_effect.items():
            k = self.effects[name]
            if self.variance_kg2[k] > 0.0:
                rest[:, k] = 0.0
                squared[:, k] = (
                    compute_two_sided_student_factor(
                        confidence_1, np.array([float(degrees_of_freedom)])
                    )[0]
                    ** 2
                )
        common = compute_two_sided_student_factor(
            confidence_1,
            self._count_degrees_of_freedom(
                rest, rest @ self.variance_kg2 + additional_variance_kg2
            ),
        )
        return np.where(squared > 0.0, squared, common[:, None] ** 2), common**2

    def _count_degrees_of_freedom(self, gradients: Floats, total_variances: Floats) -> Floats:
        """Degrees of freedom (n,) of variances (n,) with gradients (n, effects)."""
        if self.covariance.size == 0:
            return np.full(total_variances.size, np.inf)
        variances = Variances(self.variance_kg2[self.estimated], self.covariance)
        return np.array(
            [
                variances.compute_satterthwaite_degrees_of_freedom(
                    row[self.estimated], float(all_kg2)
                )
                for row, all_kg2 in zip(gradients, total_variances, strict=True)
            ]
        )


def compute_two_sided_student_factor(confidence_1: float, degrees_of_freedom: Floats) -> Floats:
    """Student factor of a two-sided interval, by element; infinite degrees of freedom: normal."""
    level = 0.5 + 0.5 * confidence_1
    finite = np.isfinite(degrees_of_freedom)
    return np.where(finite, stdtrit(np.where(finite, degrees_of_freedom, 1.0), level), ndtri(level))
