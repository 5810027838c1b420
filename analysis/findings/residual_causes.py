"""Causes in the residual of the force: coloured noise, uneven noise, oscillation or hysteresis.

At standstill the same combination of channels contains only the noise of the instruments; the
spectrum while driving is compared with the one at standstill.
"""

from typing import NamedTuple

import numpy as np

from analysis.findings.cause import MassChange, Symptom
from analysis.findings.finding_inputs import FindingInputs
from analysis.findings.finding_limits import LIMITS
from analysis.model.schema import get_column_values
from analysis.stages.motion.forces import compute_longitudinal_force, compute_regressor_acceleration
from analysis.weighing.force_hysteresis import HYSTERESIS
from analysis.weighing.joint_result import JointFit
from analysis.weighing.missing_terms import ELASTICITY, WARMING
from analysis.weighing.swinging_mass import SWINGING_MASS, SwingingMass
from estimators.arrays import Bools, Floats


class ResidualSpectra(NamedTuple):
    """Power by frequency, (k,), in motion and at standstill."""

    hz: Floats
    driving: Floats
    standing: Floats
    counts: tuple[int, int]


def get_force_residual_spectra(inputs: FindingInputs) -> ResidualSpectra | None:
    """Spectra of f - m a - b v; None if standstill or motion is too short, or the grid too slow."""
    if "spectra" in inputs.cache:
        return inputs.cache["spectra"]  # type: ignore[return-value]
    inputs.cache["spectra"] = found = _compute_force_residual_spectra(inputs)
    return found


def _compute_force_residual_spectra(inputs: FindingInputs) -> ResidualSpectra | None:
    fit, aligned, machine = inputs.fit_without_learnt_priors, inputs.aligned, inputs.machine
    rate_hz = machine.settings.align.rate_hz
    if rate_hz <= 2.0 * LIMITS.reference_band_hz[0]:
        return None
    straight = inputs.check_inputs.straight_motion
    mass_kg, viscous = fit_pooled_mass_and_friction(inputs)
    lag = fit.force_delay_s if fit is not None and fit.is_force_advanced_by_lag else 0.0
    used = straight.moving if fit is None else fit.motion.is_fittable
    rows = np.arange(aligned.height, dtype=np.float64)
    force = compute_longitudinal_force(aligned, machine.machine)
    force = np.interp(rows + lag * rate_hz, rows, force)
    A = np.column_stack(
        [
            compute_regressor_acceleration(aligned, machine),
            get_column_values(aligned, "speed_x_m_s"),
        ]
    )
    left = force - A @ np.array([mass_kg, viscous])
    known = np.isfinite(left)
    driving = compute_power_spectra_of_stretches(left, used & known, 2)
    standing = compute_power_spectra_of_stretches(left, inputs.is_resting_sample & known, 1)
    if min(len(driving), len(standing)) < LIMITS.spectrum_counts[0]:
        return None
    hz = np.arange(LIMITS.spectrum_samples // 2 + 1) * rate_hz / LIMITS.spectrum_samples
    counts = (len(driving), len(standing))
    return ResidualSpectra(
        hz, average_spectra_robustly(driving), average_spectra_robustly(standing), counts
    )


def fit_pooled_mass_and_friction(inputs: FindingInputs) -> tuple[float, float]:
    """Mass in kg and viscous friction in N·s/m by the pooled fit of moving means.

    Vibration biases the mass of shorter means.
    """
    totals = inputs.check_inputs.totals
    if totals is not None:
        pooled = totals.filter(totals["method"] == "pooled")
        both = [get_column_values(pooled, name) for name in ("mass_kg", "friction_x_N_s_m")]
        if pooled.height and np.isfinite(both).all():
            return float(both[0][0]), float(both[1][0])
    fit = inputs.fit_without_learnt_priors
    if fit is not None:
        return fit.mass_kg, fit.viscous_friction
    return inputs.check_inputs.straight_motion.ungated_fit.value, 0.0


def compute_power_spectra_of_stretches(
    signal: Floats, used_samples: Bools, trend_degree: int
) -> list[Floats]:
    """Power spectrum (frequencies,) of each used stretch, with a polynomial trend removed."""
    edges = np.flatnonzero(
        np.diff(np.concatenate([[False], used_samples, [False]]).astype(np.int8))
    )
    window = np.hanning(LIMITS.spectrum_samples)
    ramp = np.linspace(-1.0, 1.0, LIMITS.spectrum_samples)
    own = np.vander(ramp, trend_degree + 1)
    out: list[Floats] = []
    for start, end in zip(edges[::2], edges[1::2], strict=True):
        for first in range(
            int(start), int(end) - LIMITS.spectrum_samples + 1, LIMITS.spectrum_samples // 2
        ):
            part = slice(first, first + LIMITS.spectrum_samples)
            rest = signal[part] - own @ np.linalg.lstsq(own, signal[part], rcond=None)[0]
            out.append(np.abs(np.fft.rfft(rest * window)) ** 2)
            if len(out) >= LIMITS.spectrum_counts[1]:
                return out
    return out


def average_spectra_robustly(spectra: list[Floats]) -> Floats:
    """Mean spectrum (frequencies,) without the largest values, which may be stops or knocks."""
    kept = max(round(LIMITS.averaged_spectra_fraction * len(spectra)), 1)
    return np.sort(np.array(spectra), axis=0)[:kept].mean(axis=0)


def _median_power_in_band(hz: Floats, spectrum: Floats, low_hz: float, high_hz: float) -> float:
    return float(np.median(spectrum[(hz >= low_hz) & (hz <= high_hz)]))


def find_resonance_of_residual(inputs: FindingInputs) -> list[Symptom]:
    """Find a mass on a spring, or a peak in the ratio of spectra in motion and at standstill."""
    fit = inputs.fit_without_learnt_priors
    weighing = inputs.check_inputs.weighing
    swinging_mass = None if weighing is None else weighing.swinging_mass
    if fit is not None and swinging_mass and fit.estimate_of_term(SWINGING_MASS[0].name) > 0.0:
        return [_report_swinging_mass(swinging_mass, fit)]
    springs = [each for each in inputs.reportable_missing_terms if each.term is ELASTICITY]
    if fit is not None and springs:
        (spring,) = springs
        effect_kg = float(spring.effect_kg[fit.most_frequent_state])
        return [
            Symptom(
                spring.t / LIMITS.named_term_min_std,
                f"the mass swings at {1.0 / (2.0 * np.pi * np.sqrt(spring.value)):.1f} Hz relative "
                "to the motion sensor, so a part between them flexes, or the log has a smoothed "
                f"motion; a model with it changes the mass by {effect_kg:+.3g} kg, which is not "
                "corrected",
                channel=next(iter(inputs.speed_channels), None),
                change=lambda: MassChange(0.0, abs(effect_kg)),
            )
        ]
    found = get_force_residual_spectra(inputs)
    if found is None:
        return []
    hz = found.hz
    band = (hz >= LIMITS.resonance_band_hz[0]) & (hz <= LIMITS.resonance_band_hz[1])
    # noise at standstill is smooth in frequency, so its spectrum is smoothed
    smooth = np.convolve(found.standing, np.ones(5) / 5.0, "same")
    ratio = found.driving / np.maximum(smooth, 1e-12)
    usual = max(float(np.median(ratio[band])), 1.0)
    # a resonance also falls off below its frequency, while residuals of steps grow towards 0 Hz
    below = np.where(hz >= LIMITS.below_resonance_hz, ratio, np.inf)
    stands_out = ratio / np.maximum(np.minimum.accumulate(below), usual)
    at = int(np.argmax(np.where(band, stands_out, 0.0)))
    peak = float(stands_out[at])
    return [
        Symptom(
            peak / LIMITS.resonance_peak_ratio,
            f"at {hz[at]:.1f} Hz the residual of the fit oscillates with {np.sqrt(peak):.1f} "
            "times the amplitude of its noise",
        )
    ]


def _report_swinging_mass(swinging_mass: SwingingMass, fit: JointFit) -> Symptom:
    """Report a mass that swings relative to the machine, which the fit models."""
    common = SWINGING_MASS[0].name
    mass_kg, t = fit.estimate_of_term(common), fit.abs_t_by_term[common]
    return Symptom(
        # the search has found it
        max(t / LIMITS.named_term_min_std, 1.0),
        f"a mass of about {float(f'{mass_kg:.2g}'):,.0f} kg swings relative to the machine at "
        f"{swinging_mass.frequency_hz:.2f} Hz, like a hanging load, a liquid, a mast or a coupled "
        "wagon; the fit models it",
    )


def find_residual_noise_growth_in_motion(inputs: FindingInputs) -> list[Symptom]:
    """Find more residual noise in motion than at standstill."""
    found = get_force_residual_spectra(inputs)
    if found is None:
        return []
    driving, standing = (
        _median_power_in_band(found.hz, power, *LIMITS.reference_band_hz)
        for power in (found.driving, found.standing)
    )
    # coarse readings stand exactly still, and show no noise
    ratio = driving / standing if standing > LIMITS.still_noise_ratio * driving else 0.0
    return [
        Symptom(
            ratio / LIMITS.driving_noise_ratio,
            f"the residual of the fit has {np.sqrt(ratio):.1f} times the noise at standstill",
        )
    ]


def find_slow_noise_at_standstill(inputs: FindingInputs) -> list[Symptom]:
    """Find slow noise of the channels at standstill, beyond white noise."""
    found = get_force_residual_spectra(inputs)
    if found is None:
        return []
    slow = _median_power_in_band(found.hz, found.standing, 0.5, LIMITS.slow_noise_hz)
    fast = _median_power_in_band(found.hz, found.standing, *LIMITS.reference_band_hz)
    ratio = slow / max(fast, 1e-12)
    return [
        Symptom(
            ratio / LIMITS.slow_noise_ratio,
            f"below {LIMITS.slow_noise_hz:g} Hz the noise has {ratio:.1f} times the power of "
            "white noise",
        )
    ]


def find_force_hysteresis(inputs: FindingInputs) -> list[Symptom]:
    """Report hysteresis of the force, for which the fit has corrected the mass."""
    fit = inputs.fit_without_learnt_priors
    if fit is None or fit.hysteresis_kg is None:
        return []
    half_N = fit.estimate_of_term(HYSTERESIS.name)
    std_N = abs(half_N) / fit.abs_t_by_term[HYSTERESIS.name]
    u_kg = fit.compute_u_by_cause_kg(fit.make_mass_coefficients_of_state(fit.most_frequent_state))[
        HYSTERESIS.name
    ]
    return [
        Symptom(
            half_N / (LIMITS.hysteresis_share * fit.motion.force_95_percentile_newtons),
            f"the force reads {half_N:.0f} ± {std_N:.0f} N less while it rises and more while it "
            f"falls, {half_N / fit.motion.force_95_percentile_newtons:.1%} of the largest force; "
            "the mass is corrected for it",
            channel=inputs.force_channel,
            change=lambda: MassChange(0.0, u_kg),
        )
    ]


def find_warming_friction(inputs: FindingInputs) -> list[Symptom]:
    """Find Coulomb friction or rolling resistance that changes after the beginning of the log."""
    fit = inputs.fit_without_learnt_priors
    found = [each for each in inputs.reportable_missing_terms if each.term is WARMING]
    if fit is None or not found:
        return []
    (warming,) = found
    effect_kg = float(warming.effect_kg[np.argmax(np.abs(warming.effect_kg))])
    way, std_N = "falls" if warming.value > 0.0 else "rises", abs(warming.value / warming.t)
    return [
        Symptom(
            abs(warming.t) / LIMITS.named_term_min_std,
            f"the resistance {way} by {abs(warming.value):.0f} ± {std_N:.0f} N over the log, most "
            f"of it at the beginning; modelling it changes a mass by {effect_kg:+,.0f} kg",
            change=lambda: MassChange(0.0, abs(effect_kg)),
        )
    ]


def find_missing_model_term(inputs: FindingInputs) -> list[Symptom]:
    """Report the term with the largest effect on a mass among those that the model lacks."""
    fit = inputs.fit_without_learnt_priors
    named = [
        each for each in inputs.reportable_missing_terms if each.term not in (ELASTICITY, WARMING)
    ]
    if fit is None:
        return []
    if not named:
        return _find_force_nonlinear_in_acceleration(inputs)
    found = named[0]
    effect_kg = float(found.effect_kg[fit.most_frequent_state])
    return [
        Symptom(
            abs(found.t) / LIMITS.named_term_min_std,
            f"{found.term.meaning}: this term is {abs(found.t):.1f} standard deviations from 0, "
            f"and changes the mass by {effect_kg:+.0f} kg; the mass is not corrected, since other "
            "terms, or ground that is uneven where starts begin, explain the force as well",
            channel=inputs.force_channel,
            change=lambda: MassChange(0.0, abs(effect_kg)),
        )
    ]


def _find_force_nonlinear_in_acceleration(inputs: FindingInputs) -> list[Symptom]:
    """Find a force in a·|a| without a term of the force or the speed that describes it better."""
    weighing = inputs.check_inputs.weighing
    if weighing is None or not weighing.curvature.is_significant:
        return []
    curvature = weighing.curvature
    return [
        Symptom(
            abs(curvature.t) / inputs.machine.settings.verdict.curvature_t_max,
            "the force is not linear in the acceleration: a term in a·|a| is "
            f"{abs(curvature.t):.1f} standard deviations from 0, and changes the mass by "
            f"{curvature.mass_change_kg:+,.0f} kg; the mass is not corrected, since the force may "
            "be compressed near its limit or not be measured on all wheels, or the machine may be "
            "slowed by curves or by softer ground in some starts",
            channel=inputs.force_channel,
            change=lambda: MassChange(0.0, abs(curvature.mass_change_kg)),
        )
    ]
