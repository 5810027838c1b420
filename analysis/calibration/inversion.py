"""From a later m̂ back to its mass: classical calibration inverted, with Fieller's interval."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.special import ndtri, stdtrit

from analysis.calibration.model import REPEATABILITY, RUN, FittedLine
from analysis.calibration.variance_components import Floats, Variances

_UNBOUNDED: Final = float("nan")


@dataclass(frozen=True, eq=False)
class Inverted:
    """Masses: each (n,), NaN limits where the slope cannot be told from 0."""

    mass_kg: Floats
    u_kg: Floats
    low_kg: Floats
    high_kg: Floats
    factor_1: Floats
    freedom: Floats


@dataclass(frozen=True, eq=False)
class Inversion:
    """A line y = level + slope (x - centre) with what scatters later values of y.

    Attributes:
        centre_kg: where the line has its level.
        level_kg: of the line.
        slope_1: of the line.
        effects: index of each effect by name.
        variance_kg2: (effects,) of one draw.
        on_line: (effects, 2, 2) what a variance of 1 gives level and slope.
        scatters: (effects,) whether a later value has it anew.
        estimated: (estimated,) which effects' variances are estimated.
        covariance: (estimated, estimated) of these variances.
        extra_kg2: variance of every later value that the points do not show.
    """

    centre_kg: float
    level_kg: float
    slope_1: float
    effects: Mapping[str, int]
    variance_kg2: Floats
    on_line: Floats
    scatters: Floats
    estimated: Floats
    covariance: Floats
    extra_kg2: float = 0.0

    @classmethod
    def of(cls, line: FittedLine, extra_kg2: float = 0.0) -> "Inversion":
        """The inverse of a fitted line."""
        effects = line.effects
        return cls(
            centre_kg=line.centre_kg,
            level_kg=line.level_kg,
            slope_1=line.slope_1,
            effects={effect.name: k for k, effect in enumerate(effects)},
            variance_kg2=np.array([effect.variance_kg2 for effect in effects]),
            on_line=np.array([effect.on_line for effect in effects]),
            scatters=np.array([float(effect.scatters) for effect in effects]),
            estimated=np.flatnonzero([effect.estimated for effect in effects]),
            covariance=line.variances.covariance,
            extra_kg2=extra_kg2,
        )

    def inverted(
        self, y_kg: Floats, readings: Floats, u_random_kg: Floats, confidence_1: float
    ) -> Inverted:
        """The mass of each later m̂.

        Its random part is that of the campaign, for so many readings, and what its own standard
        uncertainty says beyond that. The Student factor is that of Welch and Satterthwaite.

        Args:
            y_kg: (n,) m̂.
            readings: (n,) whose mean each is.
            u_random_kg: (n,) its own random standard uncertainty; NaN where it has none.
            confidence_1: of the intervals.

        Source:
            Fieller (1954); Draper and Smith, Applied Regression Analysis, 3.2 (inverse regression).
        """
        new = self._new(readings)
        own = new @ self.variance_kg2
        random = new[:, self._random()] * self.variance_kg2[self._random()]
        beyond = np.fmax(np.nan_to_num(u_random_kg) ** 2 - random, 0.0)
        return self._solved(y_kg, new, own + beyond + self.extra_kg2, confidence_1)

    def exact(self, y_kg: float, confidence_1: float) -> Inverted:
        """Where the line itself has the value `y_kg`: nothing scatters it."""
        none = np.zeros((1, self.variance_kg2.size))
        return self._solved(np.array([y_kg]), none, np.zeros(1), confidence_1)

    def slope_interval(self, confidence_1: float) -> tuple[float, float]:
        """Interval of the slope."""
        gradient = self.on_line[:, 1, 1]
        variance = float(gradient @ self.variance_kg2)
        factor = student(confidence_1, self._freedom(gradient[None], np.array([variance])))[0]
        half = factor * np.sqrt(variance)
        return self.slope_1 - half, self.slope_1 + half

    def parts_kg(self, mass_kg: float, readings: float) -> tuple[Floats, Floats]:
        """(effects,) of a later mass' standard uncertainty: anew, and through the line."""
        away = np.array([1.0, mass_kg - self.centre_kg])
        through = np.einsum("i,kij,j->k", away, self.on_line, away)
        anew = self._new(np.array([readings]))[0]
        size = abs(self.slope_1)
        return (
            np.sqrt(anew * self.variance_kg2) / size,
            np.sqrt(np.maximum(through, 0.0) * self.variance_kg2) / size,
        )

    def _random(self) -> int:
        """The effect that readings average out, or else the one that has it in it."""
        return self.effects.get(REPEATABILITY, self.effects.get(RUN, 0))

    def _new(self, readings: Floats) -> Floats:
        """(n, effects) of each variance in a later value."""
        new = np.tile(self.scatters, (readings.size, 1))
        if REPEATABILITY in self.effects:
            new[:, self.effects[REPEATABILITY]] /= readings
        return new

    def _solved(self, y_kg: Floats, new: Floats, own_kg2: Floats, confidence_1: float) -> Inverted:
        """Mass, uncertainty and interval of values with the given share of each effect anew."""
        away = (y_kg - self.level_kg) / self.slope_1
        line = np.tensordot(self.variance_kg2, self.on_line, 1)
        at = np.stack([np.ones_like(away), away], -1)
        through = np.einsum("ni,kij,nj->nk", at, self.on_line, at)
        total = own_kg2 + through @ self.variance_kg2
        freedom = self._freedom(new + through, total)
        factor = student(confidence_1, freedom)
        # (d - s h)² = t² (own + v00 + 2 h v01 + h² v11), for h from the centre
        squared = factor**2
        d = y_kg - self.level_kg
        a = self.slope_1**2 - squared * line[1, 1]
        b = d * self.slope_1 + squared * line[0, 1]
        c = d**2 - squared * (own_kg2 + line[0, 0])
        bounded = a > 0.0
        a = np.where(bounded, a, 1.0)
        half = np.sqrt(np.maximum(b**2 - a * c, 0.0)) / a
        return Inverted(
            mass_kg=self.centre_kg + away,
            u_kg=np.sqrt(total) / abs(self.slope_1),
            low_kg=np.where(bounded, self.centre_kg + b / a - half, _UNBOUNDED),
            high_kg=np.where(bounded, self.centre_kg + b / a + half, _UNBOUNDED),
            factor_1=factor,
            freedom=freedom,
        )

    def _freedom(self, gradient: Floats, total: Floats) -> Floats:
        """(n,) degrees of freedom of variances (n,) with gradients (n, effects)."""
        if self.covariance.size == 0:
            return np.full(total.size, np.inf)
        variances = Variances(self.variance_kg2[self.estimated], self.covariance)
        return np.array(
            [
                variances.freedom(row[self.estimated], float(all_kg2))
                for row, all_kg2 in zip(gradient, total, strict=True)
            ]
        )


def student(confidence_1: float, freedom: Floats) -> Floats:
    """Student's factor of a two-sided interval; the normal one where the freedom is infinite."""
    level = 0.5 + 0.5 * confidence_1
    finite = np.isfinite(freedom)
    return np.where(finite, stdtrit(np.where(finite, freedom, 1.0), level), ndtri(level))
