"""What the noise of an axis' columns does to its estimates, and how much of that is uncertain."""

import numpy as np

from analysis.regressor import Axis, Floats, X
from analysis.settings import EXACT, Method, Settings
from estimators.attenuation import DOUBT, window_attenuations
from estimators.estimate import Ints


def column_noise(axis: Axis, settings: Settings) -> Floats | None:
    """R.m.s. noise (p,) of an axis' columns after the moving mean; None where A is near enough.

    A yaw acceleration is a derivative, whose noise draws the inertia towards zero by a percent; an
    accelerometer's draws the mass by less than a tenth of a kilogram.
    """
    if axis is X:
        return None
    raw = np.array([settings.noise.yaw_acc_rad_s2, settings.noise.yaw_rate_rad_s])
    return raw / np.sqrt(settings.smooth.samples)


def systematic(
    axis: Axis,
    method: Method,
    A: Floats,
    f: Floats,
    index: Ints,
    theta: Floats,
    settings: Settings,
) -> Floats:
    """What the residuals of a window do not show of its error, (rows, p), signed.

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
    noise = column_noise(axis, settings)
    if noise is None:
        return np.zeros_like(theta)
    drawn = window_attenuations(A, f, settings.gate.window_samples, index, theta, noise)
    return drawn if method in EXACT else DOUBT * drawn
