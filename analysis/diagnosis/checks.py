"""The table of checks: whether a log can weigh, judged on all moving samples, ungated.

A gate does not protect against a log that cannot weigh: among enough windows some look good by
chance. So the checks use all moving samples: straight motion for the mass, spins for the inertia.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
import polars as pl

from analysis.diagnosis.check_inputs import AxisMotion, CheckInputs
from analysis.diagnosis.check_row import CheckRow
from analysis.diagnosis.diagnosis_limits import LIMITS
from analysis.diagnosis.fit_checks import FIT_CHECKS
from analysis.diagnosis.signal_checks import SIGNAL_CHECKS
from analysis.model.axes import X
from analysis.model.machine import Machine
from analysis.model.schema import build_frame, get_column_values
from analysis.model.verdict import EvidenceSubject, Verdict
from analysis.model.windows import flag_windows_with_flagged_rows
from analysis.stages.estimation import fit_quality
from analysis.stages.gating.gate import mark_samples_for_pooling
from analysis.stages.motion.phases import (
    average_acceleration_over_rate_span,
    count_rows_in_speed_rate_span,
)
from analysis.stages.noise.column_noise import ColumnNoise
from analysis.stages.signals.grid_rate import count_rows_in_duration
from analysis.stages.signals.signal_limits import LIMITS as SIGNAL_LIMITS

#: Name of the check that fails if a finding invalidates the mass.
INVALIDATING_CAUSES: Final = "invalidating_causes"
_MEANING: Final = "named causes that invalidate a mass which no other check withholds"
_REMEDY: Final = "payscope explain shows each, and the setting that corrects it if there is one"
_SCALE_REMEDY: Final = (
    "the scale and unit of the force, machine.wheel_radius_m, machine.force_share, "
    "machine.empty_mass_kg"
)


def judge_log_by_checks(inputs: CheckInputs) -> pl.DataFrame:
    """Judge the log by every check of the table.

    Returns:
        `verdict`: a row per check; `passed` is null if the check does not apply.
    """
    machine = inputs.machine
    motions = {"mass": inputs.straight_motion, "inertia": inputs.spin_motion}
    judged = [(row, motion) for row in CHECKS if (motion := motions[row.about]) is not None]
    limits = machine.settings.verdict.model_dump()

    def make_float_series(values: list[float | None]) -> pl.Series:
        return pl.Series(values, dtype=pl.Float64)

    frame = pl.DataFrame(
        {
            "check": [row.name for row, _ in judged],
            "about": [row.about for row, _ in judged],
            "value": make_float_series(
                [row.number(inputs, motion) for row, motion in judged]
            ).fill_nan(None),
            "minimum": make_float_series(
                [limits[row.minimum] if row.minimum else None for row, _ in judged]
            ),
            "maximum": make_float_series(
                [limits[row.maximum] if row.maximum else None for row, _ in judged]
            ),
            "meaning": [row.describe_measured_quantity(inputs, motion) for row, motion in judged],
            "consequence": [row.decide_consequence(inputs, motion) for row, motion in judged],
            "remedy": [row.describe_remedy(inputs, motion) for row, motion in judged],
        }
    )
    inside = (pl.col("value") >= pl.col("minimum").fill_null(-np.inf)) & (
        pl.col("value") <= pl.col("maximum").fill_null(np.inf)
    )
    applies = pl.Series([row.applies(inputs, motion) for row, motion in judged], dtype=pl.Boolean)
    optional = pl.Series([row.optional for row, _ in judged], dtype=pl.Boolean)
    is_known = frame["value"].is_finite().fill_null(value=False)
    passed = pl.when(applies & (is_known | ~optional)).then(inside.fill_null(False))
    return build_frame("verdict", frame.with_columns(passed=passed).to_dict())


def _compute_partial_correlation(_inputs: CheckInputs, motion: AxisMotion) -> float:
    return fit_quality.compute_partial_correlation(motion.A, motion.f, motion.moving)


def compute_correlation_unless_brief(inputs: CheckInputs, motion: AxisMotion) -> float:
    """Partial correlation of force and acceleration; NaN if the machine moves too briefly."""
    rate_hz = inputs.machine.settings.align.rate_hz
    fewest = count_rows_in_duration(
        LIMITS.correlation_min_moving_s, rate_hz, SIGNAL_LIMITS.window_min_readings
    )
    few = np.count_nonzero(motion.moving) < fewest
    return np.nan if few else _compute_partial_correlation(inputs, motion)


def _compute_relative_ungated_mass_std(_inputs: CheckInputs, motion: AxisMotion) -> float:
    fit = motion.ungated_fit
    return fit.std / abs(fit.value) if fit.value else np.inf


def _compute_explained_force_variance_fraction(inputs: CheckInputs, motion: AxisMotion) -> float:
    return motion.compute_explained_variance_fraction(inputs.machine.settings)


def _compute_fraction_braked_with_opposing_force(_inputs: CheckInputs, motion: AxisMotion) -> float:
    """Fraction of samples braked by the drive whose force opposes the motion."""
    return fit_quality.compute_fraction_of_braked_samples_with_opposing_force(
        motion.A, motion.f, motion.braking, motion.speeding
    )


def _compute_fraction_braked_with_opposing_torque(inputs: CheckInputs, motion: AxisMotion) -> float:
    """Fraction of spin samples braked by the drive whose yaw torque opposes the spin.

    Scrubbing tyres may stop a spin while the torque that drove it is still falling.
    """
    settings = inputs.machine.settings
    rows = count_rows_in_duration(LIMITS.falling_torque_s, settings.align.rate_hz)
    rows += settings.smooth.samples
    still_falling = flag_windows_with_flagged_rows(motion.speeding, rows)
    return fit_quality.compute_fraction_of_braked_samples_with_opposing_force(
        motion.A,
        motion.f,
        motion.braking & ~still_falling,
        motion.speeding,
        has_scrubbing_tyres=True,
    )


def _compute_fraction_driven_by_assisting_force(_inputs: CheckInputs, motion: AxisMotion) -> float:
    """Fraction of accelerating samples whose force acts along the motion."""
    rate = motion.speed_or_yaw_rate
    # without samples that gravity drives downhill, where the force holds back
    chosen = motion.speeding & (motion.A[:, 0] * np.sign(rate) > -LIMITS.driven_downhill_min_m_s2)
    chosen = chosen if chosen.any() else motion.speeding
    return fit_quality.compute_fraction_of_samples_with_force_along_motion(rate, motion.f, chosen)


def _compute_imu_to_wheel_acceleration_slope(inputs: CheckInputs, motion: AxisMotion) -> float:
    """Slope of the accelerometer against the wheels' acceleration in straight motion."""
    used = motion.complete & inputs.mark_samples_in_phases("accelerating", "cruising", "braking")
    measured = get_column_values(inputs.excitation, "specific_force_x_m_s2")
    imu = average_acceleration_over_rate_span(measured, inputs.machine.settings)
    rate = get_column_values(inputs.excitation, "speed_rate_x_m_s2")
    return fit_quality.fit_slope_with_noisy_x(
        rate, imu, used, compute_wheel_acceleration_noise_variance(inputs)
    )


def compute_wheel_acceleration_noise_variance(inputs: CheckInputs) -> float:
    """Variance of the wheel acceleration due to noise of the speed, in m²/s⁴."""
    settings = inputs.machine.settings
    known = (
        None
        if inputs.noise is None
        else ColumnNoise.select_axis_noise(X, inputs.noise, settings.noise)
    )
    if known is None:
        return 0.0
    # the speeds at both ends of the span are moving means
    of_mean = float(known.compute_covariance_of_means(settings.smooth.samples)[1, 1])
    return 2.0 * of_mean * (settings.align.rate_hz / count_rows_in_speed_rate_span(settings)) ** 2


def _count_accepted_stretches(inputs: CheckInputs, _motion: AxisMotion) -> float:
    accepted = mark_samples_for_pooling(inputs.excitation, inputs.gated, inputs.machine.settings)
    return float((np.diff(np.append(False, accepted).astype(int)) > 0).sum())


def _compute_ungated_mass_to_empty_mass_ratio(inputs: CheckInputs, motion: AxisMotion) -> float:
    empty_kg = inputs.machine.machine.empty_mass_kg
    return motion.ungated_fit.value / empty_kg if empty_kg else np.nan


def _compute_empty_mass_shortfall_in_u(inputs: CheckInputs, _motion: AxisMotion) -> float:
    """Empty mass minus the lightest load, in standard uncertainties; NaN if unknown."""
    found = inputs.empty_mass_difference
    return np.nan if found is None else -found.difference_over_uncertainty


def compute_empty_mass_difference_in_u(inputs: CheckInputs, _motion: AxisMotion) -> float:
    """Magnitude of the difference to the empty mass in u; NaN if another check covers it."""
    found = inputs.empty_mass_difference
    if found is None or not found.can_test_scale:
        return np.nan
    # a load so far below that the mass is withheld is reported by the other check
    withheld = (
        -found.difference_over_uncertainty > inputs.machine.settings.verdict.negative_payload_max_u
    )
    return np.nan if withheld else abs(found.difference_over_uncertainty)


def _describe_ratio_to_empty_mass(inputs: CheckInputs, _motion: AxisMotion) -> str:
    """Text on the ratio to the empty mass and its causes; "" if it is within its limit."""
    found = inputs.empty_mass_difference
    limit_u = inputs.machine.settings.verdict.empty_mass_max_u
    far = (
        found is not None
        and found.can_test_scale
        and abs(found.difference_over_uncertainty) > limit_u
    )
    return found.difference_and_causes_text if found is not None and far else ""


def _estimate_spin_centre_offset_m(inputs: CheckInputs, motion: AxisMotion) -> float:
    x, y = (get_column_values(inputs.excitation, f"specific_force_{axis}_m_s2") for axis in "xy")
    return fit_quality.estimate_spin_centre_offset_m(
        x, y, motion.speed_or_yaw_rate, motion.A[:, 0], motion.complete
    )


@dataclass(frozen=True, slots=True)
class AxisQuantityNames:
    """Names of an axis' quantities in the texts of its checks."""

    prefix: str
    acceleration: str
    speed: str
    parameter: str
    force: str
    moves: str


def make_model_checks(subject: EvidenceSubject, wording: AxisQuantityNames) -> tuple[CheckRow, ...]:
    """Make the checks of an axis on whether its model fits the moving samples."""
    force, moves = wording.force, wording.moves
    return (
        CheckRow(
            f"{wording.prefix}partial_correlation",
            subject,
            _compute_partial_correlation,
            f"correlation of {wording.acceleration} and {force}, with "
            f"the part that the {wording.speed} explains "
            "removed from both",
            minimum="partial_correlation_min",
            remedy="stronger starts; force and speed of the same machine and time",
        ),
        CheckRow(
            f"{wording.prefix}relative_std",
            subject,
            _compute_relative_ungated_mass_std,
            f"standard deviation of the ungated {wording.parameter} over that {wording.parameter}",
            maximum="relative_std_max",
        ),
        CheckRow(
            f"{wording.prefix}r_squared",
            subject,
            _compute_explained_force_variance_fraction,
            f"share of the {force}'s variance that {wording.parameter} and friction explain",
            minimum="r_squared_min",
        ),
        CheckRow(
            f"{wording.prefix}opposing_share",
            subject,
            _compute_fraction_braked_with_opposing_torque
            if subject == "inertia"
            else _compute_fraction_braked_with_opposing_force,
            f"fraction of samples braked by the drive in which the {force} opposes the {moves}; "
            f"0: the {force} has no sign",
            minimum="opposing_share_min",
            optional=True,
            applies=lambda _, motion: bool(motion.braking.any()),
            remedy="a force with its sign: motor currents often have none",
        ),
        CheckRow(
            f"{wording.prefix}driving_share",
            subject,
            _compute_fraction_driven_by_assisting_force,
            f"fraction of accelerating samples whose {force} acts along the {moves}; 0.5: the "
            f"{force} has no sign",
            minimum="driving_share_min",
            applies=lambda _, motion: bool(motion.speeding.any()),
        ),
    )


CHECKS: Final = (
    CheckRow(
        "force_sign",
        "mass",
        compute_correlation_unless_brief,
        "correlation of acceleration and force; strongly negative: inverted sign",
        minimum="force_sign_min",
        optional=True,
        remedy="the sign is inverted: scale = -1 in channels.force_x_N, or of both torques",
    ),
    *make_model_checks(
        "mass", AxisQuantityNames("", "acceleration", "speed", "mass", "force", "motion")
    ),
    CheckRow(
        "acceleration_gain",
        "mass",
        _compute_imu_to_wheel_acceleration_slope,
        "accelerometer over the derivative of the wheel speed; 1: they agree",
        minimum="acceleration_gain_min",
        maximum="acceleration_gain_max",
        applies=lambda inputs, _: inputs.has_grid_columns("specific_force_x_m_s2"),
    ),
    CheckRow(
        "accepted_stretches",
        "mass",
        _count_accepted_stretches,
        "separate stretches accepted by the gate",
        minimum="accepted_stretches_min",
    ),
    CheckRow(
        "empty_mass_ratio",
        "mass",
        _compute_ungated_mass_to_empty_mass_ratio,
        "mass without gating over the machine's empty mass",
        minimum="empty_mass_ratio_min",
        maximum="empty_mass_ratio_max",
        applies=lambda inputs, _: inputs.machine.machine.empty_mass_kg is not None,
    ),
    CheckRow(
        "negative_payload",
        "mass",
        _compute_empty_mass_shortfall_in_u,
        "lightest load below the machine's empty mass, in standard uncertainties including "
        "the scale's",
        maximum="negative_payload_max_u",
        optional=True,
        subject_text=_describe_ratio_to_empty_mass,
        remedy=_SCALE_REMEDY,
    ),
    CheckRow(
        "empty_mass",
        "mass",
        compute_empty_mass_difference_in_u,
        "difference of the lightest load from the machine's empty mass, in standard uncertainties; "
        "if it may be a payload, only the part beyond one",
        maximum="empty_mass_max_u",
        optional=True,
        subject_text=_describe_ratio_to_empty_mass,
        consequence="tell",
        remedy=_SCALE_REMEDY,
    ),
    *FIT_CHECKS,
    *SIGNAL_CHECKS,
    *make_model_checks(
        "inertia",
        AxisQuantityNames("spin_", "yaw acceleration", "yaw rate", "inertia", "yaw torque", "spin"),
    ),
    CheckRow(
        "spin_centre_m",
        "inertia",
        _estimate_spin_centre_offset_m,
        "distance in m of the centre of rotation in spins from the origin, by the accelerometer; "
        "if it is large, mass leaks into the inertia estimate",
        maximum="spin_centre_max_m",
        applies=lambda inputs, _: inputs.has_grid_columns(
            "specific_force_x_m_s2", "specific_force_y_m_s2"
        ),
    ),
)


def add_check_of_invalidating_findings(
    verdict: pl.DataFrame, findings: pl.DataFrame, machine: Machine
) -> pl.DataFrame:
    """Add the check that fails if a finding invalidates the mass.

    Args:
        verdict: the frame `verdict`.
        findings: findings of the same log.
        machine: machine file with the limit of the check.

    Returns:
        `verdict` with one more row, after those of the mass.
    """
    # if the mass is withheld already, the finding alone reports the cause
    is_open = Verdict.from_frame(verdict).can_weigh
    grave = findings.filter(pl.col("severity") == "withhold", pl.lit(is_open))
    most = machine.settings.verdict.causes_max
    names = ", ".join(name.replace("_", " ") for name in grave["cause"])
    row = pl.DataFrame(
        {
            "check": [INVALIDATING_CAUSES],
            "about": ["mass"],
            "value": [float(grave.height)],
            "minimum": pl.Series([None], dtype=pl.Float64),
            "maximum": [float(most)],
            "passed": [grave.height <= most],
            "meaning": [f"{_MEANING} ({names})" if names else _MEANING],
            "consequence": ["withhold"],
            "remedy": [_REMEDY],
        }
    )
    of_mass = verdict.filter(pl.col("about") == "mass").height
    parts = [
        verdict.head(of_mass),
        row.select(verdict.columns),
        verdict.tail(verdict.height - of_mass),
    ]
    cast = [part.cast(dict(verdict.schema)) for part in parts]  # type: ignore[arg-type]
    return build_frame("verdict", pl.concat(cast).to_dict())
