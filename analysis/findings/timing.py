"""Delays between force, wheels and accelerometer, and clocks that run apart."""

from typing import Final

import numpy as np

from analysis.findings.case import Case
from analysis.findings.cause import Sign
from analysis.findings.mending import mended

#: So many deviations, and so much time, a delay must be.
_DEVIATIONS: Final = 4.5
_LEAST_S: Final = 0.004


def delay(case: Case) -> Sign | None:
    """The lag that maximises the likelihood of f(t - d) = m a + b v + nuisances (the joint fit)."""
    fit = case.fit
    if fit is None:
        return None
    place = [term.name for term in fit.terms].index("lag")
    late_s, std_s = (float(each[place]) for each in fit.posterior)
    strength = abs(late_s) / max(_DEVIATIONS * std_s, _LEAST_S)
    channels = case.measured("force_x_N", "torque_left_N_m", "torque_right_N_m")
    values = [case.machine.channels[name].delay_s + late_s for name in channels]
    return Sign(
        strength,
        f"the force is {1e3 * late_s:.1f} ± {1e3 * std_s:.1f} ms late against the acceleration",
        channel=case.force_channel,
        setting=", ".join(f"channels.{name}.delay_s" for name in channels),
        value=", ".join(f"{value:.4f}" for value in values),
        change=lambda: mended(
            case, lambda motion: motion.with_force_moved_back(late_s), std_s / abs(late_s)
        ),
    )


def clock_drift(case: Case) -> Sign | None:
    """Two topics' header stamps against their log times."""
    signals = case.evidence.signals
    if signals is None or signals.drift is None:
        return None
    drift = signals.drift
    limit_s = case.machine.settings.verdict.clocks_max_s
    strength = min(
        drift.drift_ppm / (5.0 * drift.drift_std_ppm),
        drift.drift_ppm * 1e-6 * signals.span_s / limit_s,
    )
    return Sign(
        float(np.nan_to_num(strength)),
        f"the clock of {drift.faster} runs {drift.drift_ppm:.0f} ± {drift.drift_std_ppm:.0f} ppm "
        f"faster than that of {drift.slower}",
        channel=next(
            (n for n, c in case.machine.channels.items() if c.topic == drift.faster), None
        ),
    )
