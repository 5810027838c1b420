"""Fraction of the wheels' acceleration that the accelerometer measures while moving."""

import numpy as np

from analysis.findings.channel_limits import LIMITS
from analysis.findings.constant_forces import compute_gravity_by_pitch_m_s2
from analysis.findings.finding_inputs import ACC, FindingInputs
from analysis.model.schema import get_column_values
from estimators.arrays import Floats


def fit_imu_to_wheel_acceleration_gain_and_std(inputs: FindingInputs) -> tuple[float, float] | None:
    """Regress the accelerometer on the wheels' acceleration.

    Returns:
        Slope and its standard deviation, dimensionless; None if the log has too little motion.
    """
    if ACC not in inputs.aligned.columns or not inputs.select_measured_channels(ACC):
        return None
    rate_hz = inputs.machine.settings.align.rate_hz
    size = max(round(LIMITS.gain_span_s * rate_hz), 1)
    span_s = size / rate_hz
    count = inputs.aligned.height // size
    if count < LIMITS.gain_min_spans:
        return None

    def block_means(x: Floats) -> Floats:
        return x[: count * size].reshape(count, size).mean(axis=1)

    speed = block_means(get_column_values(inputs.aligned, "speed_x_m_s"))
    reads = block_means(
        get_column_values(inputs.aligned, ACC) - compute_gravity_by_pitch_m_s2(inputs)
    )
    moves = block_means((~inputs.is_standing_sample).astype(float)) > 0.0
    x, y = np.diff(speed) / span_s, (reads[1:] + reads[:-1]) / 2.0
    used = np.isfinite(x) & np.isfinite(y) & moves[1:] & moves[:-1]
    if used.sum() < LIMITS.gain_min_spans:
        return None
    x, y = x[used] - x[used].mean(), y[used] - y[used].mean()
    # noise of the speed is no acceleration, and would look like one that is not seen
    reads_speed = (
        0.0
        if inputs.column_noise is None
        else inputs.column_noise.noise_covariance_of_means(size)[1, 1]
    )
    seen = float(x @ x)
    power = seen - x.size * 2.0 * reads_speed / span_s**2
    if not power > LIMITS.gain_motion_fraction * seen:
        return None
    gain = float(x @ y) / power
    # neighbours share half of what they are of
    std = float(np.sqrt(1.5 * seen * ((y - gain * x) ** 2).sum() / (x.size - 2))) / power
    # what noise is taken off is known to a share of it
    return gain, float(np.hypot(std, gain * LIMITS.gain_noise_u_1 * (seen - power) / power))
