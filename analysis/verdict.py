"""Whether a log can weigh at all, judged on its ungated moving samples.

A gate cannot protect from a log that holds no answer: of enough windows some look fine. So the
checks here look at everything that moved, each with its number and its limit.
"""

import numpy as np
import polars as pl
from numpy.typing import NDArray

from analysis.gate import accepted_samples
from analysis.machine import Machine
from analysis.phases import beside_speed_rate
from analysis.regressor import straight
from analysis.schema import build, values
from analysis.settings import Settings
from estimators import pooled

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

#: Fewer moving samples than parameters times this decide nothing.
_ENOUGH = 10


def verdict(excitation: pl.DataFrame, gated: pl.DataFrame, machine: Machine) -> pl.DataFrame:
    """Judge the log, a row a check; `passed` is null where a check does not apply.

    Args:
        excitation: regressor and phases.
        gated: which windows were accepted, for the count of stretches alone.
        machine: empty mass, limits.
    """
    settings = machine.settings
    limits = settings.verdict
    A, f = straight(excitation, settings)
    known = np.isfinite(A).all(axis=1) & np.isfinite(f)
    phase = excitation["phase"]
    driving = ["accelerating", "cruising"] + ([] if settings.exclude_braking else ["braking"])
    moving = known & phase.is_in(driving).fill_null(False).to_numpy()
    braking = known & (phase == "braking").fill_null(False).to_numpy()
    speeding = known & (phase == "accelerating").fill_null(False).to_numpy()
    mass, deviation, r_squared = _ungated_fit(A, f, moving)
    accepted = accepted_samples(excitation, gated, settings)
    stretches = int((np.diff(np.append(False, accepted).astype(int)) > 0).sum())
    empty = machine.machine.empty_mass_kg
    body_ratio = mass / empty if empty else np.nan
    rows = [
        (
            "partial_correlation",
            _partial_correlation(A, f, moving),
            limits.partial_correlation_min,
            None,
            "correlation of acceleration and force with the speed's share taken out of both",
        ),
        (
            "relative_std",
            deviation / abs(mass) if mass else np.inf,
            None,
            limits.relative_std_max,
            "standard deviation of the ungated mass over that mass",
        ),
        (
            "r_squared",
            r_squared,
            limits.r_squared_min,
            None,
            "share of the force's variance that mass and friction explain",
        ),
        (
            "opposing_share",
            1.0 - _along_share(A[:, 1], f, braking),
            limits.opposing_share_min,
            None,
            "share of the decelerating samples whose force opposes the motion: 0 means that the "
            "force has lost its sign",
        ),
        (
            "driving_share",
            _along_share(A[:, 1], f, speeding),
            limits.driving_share_min,
            None,
            "share of the accelerating samples whose force acts along the motion: one half means "
            "that the force has lost its sign",
        ),
        (
            "acceleration_gain",
            _acceleration_gain(excitation, known & _straight(phase), settings),
            limits.acceleration_gain_min,
            limits.acceleration_gain_max,
            "accelerometer against the change of wheel speed: 1 when they agree",
        ),
        (
            "accepted_stretches",
            float(stretches),
            float(limits.accepted_stretches_min),
            None,
            "disjoint stretches that the gate accepted",
        ),
        (
            "empty_mass_ratio",
            body_ratio,
            limits.empty_mass_ratio_min,
            limits.empty_mass_ratio_max,
            "ungated mass over the machine's empty mass",
        ),
    ]
    checks, numbers, minima, maxima, meanings = zip(*rows, strict=True)
    not_applicable = {
        # no wheel force is asked to brake, no accelerometer, no empty mass: nothing to compare
        "opposing_share": not braking.any(),
        "driving_share": not speeding.any(),
        "acceleration_gain": "specific_force_x_m_s2" not in excitation.columns,
        "empty_mass_ratio": empty is None,
    }
    frame = pl.DataFrame(
        {
            "check": checks,
            "value": pl.Series(numbers, dtype=pl.Float64).fill_nan(None),
            "minimum": pl.Series(minima, dtype=pl.Float64),
            "maximum": pl.Series(maxima, dtype=pl.Float64),
            "meaning": meanings,
        }
    )
    inside = (pl.col("value") >= pl.col("minimum").fill_null(-np.inf)) & (
        pl.col("value") <= pl.col("maximum").fill_null(np.inf)
    )
    skipped = [name for name, absent in not_applicable.items() if absent]
    passed = pl.when(pl.col("check").is_in(skipped)).then(None).otherwise(inside.fill_null(False))
    return build("verdict", frame.with_columns(passed=passed).to_dict())


def can_weigh(judged: pl.DataFrame) -> bool:
    """Whether no check failed."""
    return bool(judged["passed"].fill_null(True).all())


def _straight(phase: pl.Series) -> Bools:
    return phase.is_in(["accelerating", "cruising", "braking"]).fill_null(False).to_numpy()


def _ungated_fit(A: Floats, f: Floats, moving: Bools) -> tuple[float, float, float]:
    """Mass, its standard deviation and R² of one fit over every moving sample."""
    if moving.sum() < _ENOUGH * A.shape[1]:
        return float("nan"), float("nan"), float("nan")
    traced = pooled.trace(A, f, np.where(moving, 0, -1))
    residual = f[moving] - A[moving] @ traced.theta[0]
    total = float(((f[moving] - f[moving].mean()) ** 2).sum())
    r_squared = 1.0 - float(residual @ residual) / total if total > 0 else float("nan")
    return float(traced.theta[0, 0]), float(traced.std[0, 0]), r_squared


def _partial_correlation(A: Floats, f: Floats, moving: Bools) -> float:
    """Correlation of a and F after both have been regressed on the other columns and a mean."""
    if moving.sum() < _ENOUGH * A.shape[1]:
        return float("nan")
    others = np.column_stack([A[moving, 1:], np.ones(int(moving.sum()))])
    both = np.column_stack([A[moving, 0], f[moving]])
    rest = both - others @ np.linalg.lstsq(others, both, rcond=None)[0]
    norms = np.sqrt((rest**2).sum(axis=0))
    return float(rest[:, 0] @ rest[:, 1] / norms.prod()) if norms.all() else float("nan")


def _along_share(speed: Floats, f: Floats, of: Bools) -> float:
    """Share of the samples `of` whose force acts along the motion."""
    return float((speed[of] * f[of] >= 0).mean()) if of.any() else float("nan")


def _acceleration_gain(excitation: pl.DataFrame, used: Bools, settings: Settings) -> float:
    """Slope of the accelerometer on the wheels' acceleration, both about their means."""
    wheels = values(excitation, "speed_rate_x_m_s2")
    imu = beside_speed_rate(values(excitation, "specific_force_x_m_s2"), settings)
    used = used & np.isfinite(wheels) & np.isfinite(imu)
    if used.sum() < _ENOUGH:
        return float("nan")
    x = wheels[used] - wheels[used].mean()
    y = imu[used] - imu[used].mean()
    return float(x @ y / (x @ x)) if x.any() else float("nan")
