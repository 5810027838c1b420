"""Whether a log can weigh at all, judged on its ungated moving samples.

A gate cannot protect from a log that holds no answer: of enough windows some look fine. So the
checks here look at everything that moved, each with its number and its limit. Straight motion
decides about the mass, spins decide about the inertia.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from analysis import checks
from analysis.gate import accepted_samples
from analysis.machine import Machine
from analysis.phases import beside_speed_rate, yaw_pace
from analysis.regressor import Z, axes, spin, straight
from analysis.schema import build, values
from analysis.settings import Settings, VerdictLimits

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

#: Checks of the mass that find a force without its sign, which spoils the yaw torque as well.
_SIGNS: Final = ("opposing_share", "driving_share")
#: The check that counts windows, which joint motion has no use for.
_COUNT: Final = "accepted_stretches"


@dataclass(frozen=True, slots=True)
class _Check:
    """One check: its number and limits; `applies` is whether this log has what it looks at."""

    name: str
    value: float
    minimum: float | None
    maximum: float | None
    meaning: str
    applies: bool = True


@dataclass(frozen=True, slots=True)
class _Motion:
    """The samples of one axis: its regressor, and which of them move, slow down and speed up."""

    A: Floats
    f: Floats
    moving: Bools
    braking: Bools
    speeding: Bools


def verdict(excitation: pl.DataFrame, gated: pl.DataFrame, machine: Machine) -> pl.DataFrame:
    """Judge the log, a row a check; `passed` is null where a check does not apply.

    Args:
        excitation: regressors and phases.
        gated: which windows were accepted, for the count of stretches alone.
        machine: empty mass, limits.
    """
    rows = [("mass", check) for check in _of_mass(excitation, gated, machine)]
    if Z in axes(excitation):
        rows += [("inertia", check) for check in _of_inertia(excitation, machine.settings)]
    frame = pl.DataFrame(
        {
            "check": [check.name for _, check in rows],
            "about": [about for about, _ in rows],
            "value": pl.Series([check.value for _, check in rows], dtype=pl.Float64).fill_nan(None),
            "minimum": pl.Series([check.minimum for _, check in rows], dtype=pl.Float64),
            "maximum": pl.Series([check.maximum for _, check in rows], dtype=pl.Float64),
            "meaning": [check.meaning for _, check in rows],
        }
    )
    inside = (pl.col("value") >= pl.col("minimum").fill_null(-np.inf)) & (
        pl.col("value") <= pl.col("maximum").fill_null(np.inf)
    )
    applies = pl.Series([check.applies for _, check in rows], dtype=pl.Boolean)
    passed = pl.when(applies).then(inside.fill_null(False))
    return build("verdict", frame.with_columns(passed=passed).to_dict())


def can_weigh(judged: pl.DataFrame) -> bool:
    """Whether no check of the mass failed."""
    return bool(judged.filter(about="mass")["passed"].fill_null(True).all())


def tells_inertia(judged: pl.DataFrame) -> bool:
    """Whether there are spins, none of their checks failed, and the force has its sign."""
    spins = judged.filter(about="inertia")
    signs = judged.filter(pl.col("check").is_in(_SIGNS))
    return bool(spins.height and pl.concat([spins, signs])["passed"].fill_null(True).all())


def contradicted(judged: pl.DataFrame) -> bool:
    """Whether samples speak against the log: a check with a number failed, not one without data."""
    spoken = judged.filter(pl.col("value").is_not_null() & (pl.col("check") != _COUNT))
    return not spoken["passed"].fill_null(True).all()


def _of_mass(excitation: pl.DataFrame, gated: pl.DataFrame, machine: Machine) -> Iterator[_Check]:
    settings, phase = machine.settings, excitation["phase"]
    limits = settings.verdict
    A, f = straight(excitation, settings)
    known = np.isfinite(A).all(axis=1) & np.isfinite(f)
    driving = ["accelerating", "cruising"] + ([] if settings.gate.exclude_braking else ["braking"])
    motion = _Motion(
        A,
        f,
        known & _is(phase, *driving),
        known & _is(phase, "braking"),
        known & _is(phase, "accelerating"),
    )
    mass, deviation, r_squared = checks.ungated_fit(A, f, motion.moving)
    accepted = accepted_samples(excitation, gated, settings)
    stretches = int((np.diff(np.append(False, accepted).astype(int)) > 0).sum())
    empty = machine.machine.empty_mass_kg
    yield from _of_model(motion, (mass, deviation, r_squared), limits, "", _STRAIGHT_WORDS)
    yield _Check(
        "acceleration_gain",
        _acceleration_gain(excitation, known, settings),
        limits.acceleration_gain_min,
        limits.acceleration_gain_max,
        "accelerometer against the change of wheel speed: 1 when they agree",
        applies="specific_force_x_m_s2" in excitation.columns,
    )
    yield _Check(
        _COUNT,
        float(stretches),
        float(limits.accepted_stretches_min),
        None,
        "disjoint stretches that the gate accepted",
    )
    yield _Check(
        "empty_mass_ratio",
        mass / empty if empty else np.nan,
        limits.empty_mass_ratio_min,
        limits.empty_mass_ratio_max,
        "ungated mass over the machine's empty mass",
        applies=empty is not None,
    )


def _of_inertia(excitation: pl.DataFrame, settings: Settings) -> Iterator[_Check]:
    """The same of spins, and whether they turn about the origin; nothing without spins."""
    limits = settings.verdict
    A, f = spin(excitation)
    known = np.isfinite(A).all(axis=1) & np.isfinite(f)
    spinning = known & _is(excitation["phase"], "spinning")
    changes = yaw_pace(A[:, 1], settings)
    braking = spinning & (changes < 0)
    moving = spinning & ~braking if settings.gate.exclude_braking else spinning
    if not checks.enough(A, moving):
        return
    motion = _Motion(A, f, moving, braking, spinning & (changes > 0))
    fitted = checks.ungated_fit(A, f, moving)
    yield from _of_model(motion, fitted, limits, "spin_", _SPIN_WORDS)
    sideways = "specific_force_y_m_s2"
    both = {"specific_force_x_m_s2", sideways} <= set(excitation.columns)
    forces = values(excitation, "specific_force_x_m_s2"), values(excitation, sideways)
    yield _Check(
        "spin_centre",
        checks.centre_offset(*forces, A[:, 1], A[:, 0], spinning),
        None,
        limits.spin_centre_max_m,
        "metres from the origin to the point that the accelerometer says spins turn about; off it, "
        "mass is told as inertia",
        applies=both,
    )


#: What the checks look at, in words: acceleration, speed, parameter, force, motion.
_STRAIGHT_WORDS: Final = ("acceleration", "speed", "mass", "force", "motion")
_SPIN_WORDS: Final = ("yaw acceleration", "yaw rate", "inertia", "yaw torque", "spin")


def _of_model(
    motion: _Motion,
    fitted: tuple[float, float, float],
    limits: VerdictLimits,
    prefix: str,
    words: tuple[str, str, str, str, str],
) -> Iterator[_Check]:
    """The checks that every axis must pass."""
    acceleration, speed, parameter, force, moves = words
    A, f = motion.A, motion.f
    value, deviation, r_squared = fitted
    yield _Check(
        f"{prefix}partial_correlation",
        checks.partial_correlation(A, f, motion.moving),
        limits.partial_correlation_min,
        None,
        f"correlation of {acceleration} and {force} with the {speed}'s share taken out of both",
    )
    yield _Check(
        f"{prefix}relative_std",
        deviation / abs(value) if value else np.inf,
        None,
        limits.relative_std_max,
        f"standard deviation of the ungated {parameter} over that {parameter}",
    )
    friction = "mass and friction" if parameter == "mass" else "inertia and friction"
    yield _Check(
        f"{prefix}r_squared",
        r_squared,
        limits.r_squared_min,
        None,
        f"share of the {force}'s variance that {friction} explain",
    )
    yield _Check(
        f"{prefix}opposing_share",
        1.0 - checks.along_share(A[:, 1], f, motion.braking),
        limits.opposing_share_min,
        None,
        f"share of the decelerating samples whose {force} opposes the {moves}: 0 means that the "
        f"{force} has lost its sign",
        applies=bool(motion.braking.any()),
    )
    yield _Check(
        f"{prefix}driving_share",
        checks.along_share(A[:, 1], f, motion.speeding),
        limits.driving_share_min,
        None,
        f"share of the accelerating samples whose {force} acts along the {moves}: one half means "
        f"that the {force} has lost its sign",
        applies=bool(motion.speeding.any()),
    )


def _is(phase: pl.Series, *names: str) -> Bools:
    return phase.is_in(names).fill_null(False).to_numpy()


def _acceleration_gain(excitation: pl.DataFrame, known: Bools, settings: Settings) -> float:
    """Slope of the accelerometer on the wheels' acceleration over all straight motion."""
    straight_on = _is(excitation["phase"], "accelerating", "cruising", "braking")
    imu = beside_speed_rate(values(excitation, "specific_force_x_m_s2"), settings)
    return checks.slope(values(excitation, "speed_rate_x_m_s2"), imu, known & straight_on)
