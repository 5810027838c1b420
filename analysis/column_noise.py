"""What the noise of an axis' columns does to its estimates, and how much of that is uncertain."""

import numpy as np

from analysis.methods import AxisNoise, Method
from analysis.regressor import Axis, Floats, X
from analysis.settings import Settings
from estimators.attenuation import DOUBT, window_attenuations
from estimators.estimate import Ints
from estimators.tls import TlsOptions


def axis_noise(axis: Axis, settings: Settings) -> AxisNoise:
    """Collect what the settings say of the noise of an axis.

    A yaw acceleration is a derivative, whose noise draws the inertia towards zero by a percent; an
    accelerometer's draws the mass by less than a tenth of a kilogram, and counts as none.
    """
    noise = settings.noise
    if axis is X:
        # Coulomb's sign is nearly exact
        return AxisNoise(TlsOptions((noise.acc_m_s2, noise.speed_m_s, 1e-3), noise.force_N), None)
    raw = (noise.yaw_acc_rad_s2, noise.yaw_rate_rad_s)
    return AxisNoise(
        TlsOptions(raw, noise.torque_z_N_m), np.array(raw) / np.sqrt(settings.smooth.samples)
    )


def systematic(
    axis: Axis,
    method: Method,
    A: Floats,
    f: Floats,
    index: Ints,
    theta: Floats,
    settings: Settings,
) -> Floats:
    """Compute the errors of windows that their residuals do not show, (rows, p), signed.

    The noise of the columns draws estimates towards zero. Methods that take the regressor for exact
    keep that, so it counts whole; the others take it off by a noise that is known to about half.

    Args:
        axis: x or z.
        method: a windowed or recursive one.
        A: (n, p) regressor.
        f: (n,) force or torque.
        index: (rows,) last samples of the windows.
        theta: (rows, p) their estimates.
        settings: window, noise.
    """
    noise = axis_noise(axis, settings).columns
    if noise is None:
        return np.zeros_like(theta)
    drawn = window_attenuations(A, f, settings.gate.window_samples, index, theta, noise)
    return DOUBT * drawn if method.takes_noise_off else drawn
