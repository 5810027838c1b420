"""Response of the accelerometer: to the wheels' acceleration, to starts, and to the boom."""

from typing import Final, NamedTuple

import numpy as np

from analysis.findings.channel_limits import LIMITS as CHANNEL_LIMITS
from analysis.findings.constant_forces import compute_gravity_by_pitch_m_s2, has_pitch_channel
from analysis.findings.finding_inputs import ACC, FindingInputs
from analysis.findings.finding_limits import LIMITS
from analysis.model.schema import get_column_values
from analysis.stages.motion.forces import compute_longitudinal_force
from analysis.stages.signals.grid_rate import count_rows_in_duration
from estimators.arrays import Floats

_BOOM: Final = "boom_rad"
_PITCH: Final = "pitch_rad"
#: Factors that correct a pitch: of the wrong sign, in degrees, or both.
PITCH_FACTORS: Final = (-1.0, float(np.radians(1.0)), -float(np.radians(1.0)))


class StartAndRestSpectra(NamedTuple):
    """Mean power of the accelerometer's residual, (frequencies,), after starts and at rest."""

    frequency_hz: Floats
    after_starts: Floats
    at_rest: Floats
    start_count: int


class WheelAndImuBlocks(NamedTuple):
    """Means over blocks of a drive, (blocks,) each.

    Attributes:
        wheels_m_s2: acceleration of the wheels.
        imu_m_s2: reading of the accelerometer, without the gravity that the pitch shows.
        pitch_rad: pitch; 0 where it is not measured.
        rows: grid rows of a block.
    """

    wheels_m_s2: Floats
    imu_m_s2: Floats
    pitch_rad: Floats
    rows: int


class PitchCorrection(NamedTuple):
    """Factor that corrects a pitch, and the effect of the correction.

    Attributes:
        factor: factor of the pitch.
        left_1: mean square difference of accelerometer and wheels with the factor, over that
            without.
    """

    factor: float
    left_1: float


def average_wheels_and_imu_while_driving(inputs: FindingInputs) -> WheelAndImuBlocks | None:
    """Means of the wheels' acceleration and the accelerometer; None if the log has too few."""
    if ACC not in inputs.aligned.columns or not inputs.select_measured_channels(ACC):
        return None
    rate_hz = inputs.machine.settings.align.rate_hz
    size = max(round(CHANNEL_LIMITS.gain_span_s * rate_hz), 1)
    count = inputs.aligned.height // size
    if count < CHANNEL_LIMITS.gain_min_spans:
        return None

    def average_blocks(x: Floats) -> Floats:
        return x[: count * size].reshape(count, size).mean(axis=1)

    def average_block_pairs(x: Floats) -> Floats:
        means = average_blocks(x)
        return (means[1:] + means[:-1]) / 2.0

    moves = average_blocks((~inputs.is_standing_sample).astype(float)) > 0.0
    speed = average_blocks(get_column_values(inputs.aligned, "speed_x_m_s"))
    x = np.diff(speed) / (size / rate_hz)
    y = average_block_pairs(
        get_column_values(inputs.aligned, ACC) - compute_gravity_by_pitch_m_s2(inputs)
    )
    pitch = np.zeros(x.size)
    if has_pitch_channel(inputs):
        pitch = average_block_pairs(get_column_values(inputs.aligned, _PITCH))
    used = np.isfinite(x) & np.isfinite(y) & moves[1:] & moves[:-1]
    if used.sum() < CHANNEL_LIMITS.gain_min_spans:
        return None
    return WheelAndImuBlocks(x[used], y[used], pitch[used], size)


def find_pitch_correction(inputs: FindingInputs) -> PitchCorrection | None:
    """Find the factor of the pitch with which the accelerometer fits the wheels.

    Returns:
        The correction; None if the pitch fits as it is, or if no factor clearly corrects it.
    """
    if "pitch correction" not in inputs.cache:
        inputs.cache["pitch correction"] = fit_pitch_correction(inputs)
    return inputs.cache["pitch correction"]  # type: ignore[return-value]


def fit_pitch_correction(inputs: FindingInputs) -> PitchCorrection | None:
    """Fit the pitch correction; `find_pitch_correction` caches it and says when it is None."""
    blocks = average_wheels_and_imu_while_driving(inputs)
    if blocks is None or not inputs.select_measured_channels(_PITCH):
        return None
    gravity_m_s2 = inputs.machine.machine.gravity_m_s2
    with_gravity = blocks.imu_m_s2 + gravity_m_s2 * np.sin(blocks.pitch_rad)
    known = np.column_stack([blocks.wheels_m_s2, np.ones(blocks.wheels_m_s2.size)])

    def compute_mean_square_of_rest(factor: float) -> float:
        rest = with_gravity - gravity_m_s2 * np.sin(factor * blocks.pitch_rad)
        rest -= known @ np.linalg.lstsq(known, rest)[0]
        return float((rest**2).mean())

    # a wrong pitch is worse than none, but that alone does not say how to correct it
    present, without = compute_mean_square_of_rest(1.0), compute_mean_square_of_rest(0.0)
    if present < CHANNEL_LIMITS.pitch_min_rest_m_s2**2:
        return None
    left = {factor: compute_mean_square_of_rest(factor) for factor in PITCH_FACTORS}
    best = min(left, key=left.__getitem__)
    slopes = np.column_stack([known, gravity_m_s2 * np.sin(best * blocks.pitch_rad)])
    slope = float(np.linalg.lstsq(slopes, with_gravity)[0][-1])
    is_clear = left[best] < CHANNEL_LIMITS.pitch_left_1 * min(present, without)
    if not is_clear or abs(slope - 1.0) > CHANNEL_LIMITS.pitch_slope_tolerance_1:
        return None
    return PitchCorrection(best, left[best] / present)


def fit_imu_to_wheel_acceleration_gain_and_std(inputs: FindingInputs) -> tuple[float, float] | None:
    """Regress the accelerometer on the wheels' acceleration.

    Returns:
        Slope and its standard deviation, dimensionless; None if the log has too little motion.
    """
    blocks = average_wheels_and_imu_while_driving(inputs)
    if blocks is None:
        return None
    x, y, size = blocks.wheels_m_s2, blocks.imu_m_s2, blocks.rows
    x, y, span_s = x - x.mean(), y - y.mean(), size / inputs.machine.settings.align.rate_hz
    # noise of the speed would look like an acceleration that the accelerometer does not measure
    reads_speed = (
        0.0
        if inputs.column_noise is None
        else inputs.column_noise.compute_covariance_of_means(size)[1, 1]
    )
    seen = float(x @ x)
    power = seen - x.size * 2.0 * reads_speed / span_s**2
    if not power > CHANNEL_LIMITS.gain_motion_fraction * seen:
        return None
    gain = float(x @ y) / power
    # adjacent blocks share half of their samples
    std = float(np.sqrt(1.5 * seen * ((y - gain * x) ** 2).sum() / (x.size - 2))) / power
    # the noise that is subtracted is itself uncertain by a fraction
    return gain, float(np.hypot(std, gain * CHANNEL_LIMITS.gain_noise_u_1 * (seen - power) / power))


def fit_imu_to_boom_angle_slope_and_std(inputs: FindingInputs) -> tuple[float, float] | None:
    """Regress the accelerometer at standstill on the angle of the boom.

    Returns:
        Slope and its standard deviation in m/s² per rad; None if the log has no boom or too few
        standstills, or if the angle explains too little of the readings.
    """
    if not {ACC, _BOOM} <= set(inputs.aligned.columns) or not inputs.select_measured_channels(ACC):
        return None
    reads = get_column_values(inputs.aligned, ACC) - compute_gravity_by_pitch_m_s2(inputs)
    x, y = inputs.average_blocks_at_rest(get_column_values(inputs.aligned, _BOOM), reads)
    if x.size < LIMITS.stand_min_blocks:
        return None
    x, y = x - x.mean(), y - y.mean()
    if np.sqrt(x @ x / x.size) < LIMITS.boom_min_std_rad:
        return None
    slope = float(x @ y) / float(x @ x)
    unexplained = float(((y - slope * x) ** 2).sum())
    if unexplained > LIMITS.boom_unexplained_1 * float(y @ y):
        return None
    return slope, float(np.sqrt(unexplained / (x.size - 2) / float(x @ x)))


def compute_imu_spectra_after_starts_and_at_rest(
    inputs: FindingInputs,
) -> StartAndRestSpectra | None:
    """Spectra of the accelerometer's residual after starts and at rest; None if too few."""
    rate_hz = inputs.machine.settings.align.rate_hz
    size = count_rows_in_duration(LIMITS.start_window_s, rate_hz)
    if not inputs.select_measured_channels(ACC) or rate_hz <= 2.5 * LIMITS.rocking_band_hz[1]:
        return None
    reads = get_column_values(inputs.aligned, ACC)
    speed = get_column_values(inputs.aligned, "speed_x_m_s")
    force = compute_longitudinal_force(inputs.aligned, inputs.machine.machine)
    ramp = np.linspace(-1.0, 1.0, size)
    window = np.hanning(size)

    def compute_residual_spectrum_at(start_row: int) -> Floats | None:
        part = slice(start_row, start_row + size)
        known = np.column_stack([np.vander(ramp, 4), force[part], speed[part]])
        if not (np.isfinite(known).all() and np.isfinite(reads[part]).all()):
            return None
        rest = reads[part] - known @ np.linalg.lstsq(known, reads[part], rcond=None)[0]
        return np.abs(np.fft.rfft(rest * window)) ** 2

    def average_spectra(start_rows: list[int]) -> Floats | None:
        found = [
            each
            for first in start_rows
            if (each := compute_residual_spectrum_at(first)) is not None
        ]
        return np.mean(found, axis=0) if len(found) >= LIMITS.loose_min_starts else None

    starts = find_force_rise_ends(inputs, force, size)
    still = inputs.is_resting_sample
    rests = [k for k in range(0, still.size - size, size // 2) if still[k : k + size].all()]
    driving, standing = average_spectra(starts), average_spectra(rests[:200])
    if driving is None or standing is None:
        return None
    hz = np.arange(size // 2 + 1) * rate_hz / size
    return StartAndRestSpectra(hz, driving, standing, len(starts))


def find_force_rise_ends(inputs: FindingInputs, force: Floats, min_held_samples: int) -> list[int]:
    """Grid sample at the end of each rise of the force from standstill to a level that holds."""
    rate_hz = inputs.machine.settings.align.rate_hz
    if not np.isfinite(force).any():
        return []
    pushes = np.abs(force) > LIMITS.start_force_fraction * float(
        np.nanquantile(np.abs(force), 0.98)
    )
    rises = np.flatnonzero(pushes[1:] & ~pushes[:-1]) + 1
    stood, behind = (
        count_rows_in_duration(LIMITS.start_stand_s, rate_hz),
        count_rows_in_duration(LIMITS.start_rise_s, rate_hz),
    )
    # the moving mean and the phases see a start late
    clear = count_rows_in_duration(0.2, rate_hz)
    return [
        int(k) + behind
        for k in rises
        if k > stood + clear
        and k + behind + min_held_samples < force.size
        and inputs.is_standing_sample[k - stood - clear : k - clear].all()
        and pushes[k + 2 * behind : k + min_held_samples].mean() > LIMITS.start_held_fraction
    ]


def may_noise_lower_imu_gain_from_1(inputs: FindingInputs) -> bool:
    """Whether noise of the wheels' acceleration may lower a gain of 1 to what the log shows.

    With noise in both, the gain lies between the slope of the accelerometer over the wheels and the
    reciprocal of the slope of the wheels over the accelerometer.

    Source:
        Fuller, Measurement Error Models (1987), 1.1.
    """
    blocks = average_wheels_and_imu_while_driving(inputs)
    if blocks is None:
        return False
    (wheels, common), (_, imu) = np.cov(blocks.wheels_m_s2, blocks.imu_m_s2).tolist()
    return common < wheels and 0.0 < common <= imu
