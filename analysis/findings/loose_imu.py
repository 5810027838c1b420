"""An IMU that rocks on its mount: after each start the accelerometer rings, and the force does not.

What moves slowly against the mount's own frequency only reads as an accelerometer of another scale:
x grows by gravity times the angle that the acceleration tilts it by.
"""

import numpy as np

from analysis.findings.accelerometer_share import fit_accelerometer_gain
from analysis.findings.cause import Symptom
from analysis.findings.finding_inputs import ACC, FindingInputs
from analysis.findings.finding_limits import LIMITS
from analysis.model.schema import values
from analysis.stages.motion.forces import longitudinal_force
from analysis.stages.signals.grid_rate import rows_in
from estimators.arrays import Floats


def find_loose_imu(inputs: FindingInputs) -> list[Symptom]:
    """A peak in what the force leaves of the accelerometer, in the first second of starts."""
    share = fit_accelerometer_gain(inputs)
    # a frame that swings rings too, and reads the acceleration of the wheels all the same
    if share is None or share[0] - LIMITS.loose_gain_std * share[1] < LIMITS.loose_gain_1:
        return []
    spectra = _spectra(inputs)
    if spectra is None:
        return []
    hz, starts, standing, count = spectra
    floor = float(np.median(standing))
    smooth = starts.copy()
    smooth[1:-1] = (starts[:-2] + 2.0 * starts[1:-1] + starts[2:]) / 4.0
    best, at = 0.0, 0
    for k in np.flatnonzero((hz >= LIMITS.rocking_band_hz[0]) & (hz <= LIMITS.rocking_band_hz[1])):
        below, above = (
            max(float(np.median(starts[(hz >= low * hz[k]) & (hz <= high * hz[k])])), floor)
            for low, high in (LIMITS.below_peak_band, LIMITS.above_peak_band)
        )
        peak = float(smooth[k]) / float(np.sqrt(below * above)) / LIMITS.rocking_peak_ratio
        own = float(starts[k]) / max(float(standing[k]), 1e-12) / LIMITS.peak_over_standing_ratio
        if min(peak, own) > best:
            best, at = min(peak, own), int(k)
    return [
        Symptom(
            best,
            f"it reads {share[0]:.2f} of the wheels' acceleration, and in the first second of "
            f"{count} starts it rings at {hz[at]:.1f} Hz, with "
            f"{np.sqrt(LIMITS.rocking_peak_ratio * best):.1f} times the size of what is beside "
            "that, and the force does not",
            channel=ACC,
            # slowly, it is an accelerometer of another scale
            alternatives=("resonance",),
        )
    ]


def _spectra(inputs: FindingInputs) -> tuple[Floats, Floats, Floats, int] | None:
    """Frequencies, mean power after starts and at rest, (k,) each, and the number of starts."""
    rate_hz = inputs.machine.settings.align.rate_hz
    size = rows_in(LIMITS.start_window_s, rate_hz)
    if not inputs.measured(ACC) or rate_hz <= 2.5 * LIMITS.rocking_band_hz[1]:
        return None
    reads = values(inputs.aligned, ACC)
    speed = values(inputs.aligned, "speed_x_m_s")
    force = longitudinal_force(inputs.aligned, inputs.machine.machine)
    ramp = np.linspace(-1.0, 1.0, size)
    window = np.hanning(size)

    def power(first: int) -> Floats | None:
        part = slice(first, first + size)
        known = np.column_stack([np.vander(ramp, 4), force[part], speed[part]])
        if not (np.isfinite(known).all() and np.isfinite(reads[part]).all()):
            return None
        rest = reads[part] - known @ np.linalg.lstsq(known, reads[part], rcond=None)[0]
        return np.abs(np.fft.rfft(rest * window)) ** 2

    def mean(places: list[int]) -> Floats | None:
        found = [each for first in places if (each := power(first)) is not None]
        return np.mean(found, axis=0) if len(found) >= LIMITS.loose_min_starts else None

    starts = _start_windows(inputs, force, size)
    still = inputs.stands_still
    rests = [k for k in range(0, still.size - size, size // 2) if still[k : k + size].all()]
    driving, standing = mean(starts), mean(rests[:200])
    if driving is None or standing is None:
        return None
    return np.arange(size // 2 + 1) * rate_hz / size, driving, standing, len(starts)


def _start_windows(inputs: FindingInputs, force: Floats, size: int) -> list[int]:
    """Where to look: behind the rise of a force after a standstill, that is then held."""
    rate_hz = inputs.machine.settings.align.rate_hz
    if not np.isfinite(force).any():
        return []
    pushes = np.abs(force) > LIMITS.start_force_fraction * float(
        np.nanquantile(np.abs(force), 0.98)
    )
    rises = np.flatnonzero(pushes[1:] & ~pushes[:-1]) + 1
    stood, behind = rows_in(LIMITS.start_stand_s, rate_hz), rows_in(LIMITS.start_rise_s, rate_hz)
    # the moving mean and the phases see a start late
    clear = rows_in(0.2, rate_hz)
    return [
        int(k) + behind
        for k in rises
        if k > stood + clear
        and k + behind + size < force.size
        and inputs.stands[k - stood - clear : k - clear].all()
        and pushes[k + 2 * behind : k + size].mean() > LIMITS.start_held_fraction
    ]
