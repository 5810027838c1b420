"""What the joint fit finds besides mass and friction, each against what chance gives."""

from dataclasses import replace
from typing import Final

import numpy as np

from analysis.findings.case import Case
from analysis.findings.cause import Change, Sign
from analysis.findings.imu import constant, standing_error
from analysis.findings.mending import mended
from analysis.forces import longitudinal_force
from analysis.weighing.equation import Equation

#: So many deviations a term of the fit must be from 0.
_TERM: Final = 4.5
#: An offset at standstill must be so many deviations, and this share of the driving force.
_AT_REST: Final = 5.0
_LEAST_OFFSET: Final = 0.004
#: Wheels against accelerometer: so many deviations, and this share.
_GAIN_DEVIATIONS: Final = 4.5
_LEAST_GAIN: Final = 0.01
#: Two explanations whose squared deviations differ by less are not told apart.
_APART: Final = 9.0
_CURVED: Final = 6.0
#: An answer whose standard uncertainty is this share of it has too little to go by.
_POOR: Final = 0.05
#: Share of the mass that priors alone leave open where regressors go together.
_OPEN: Final = 0.02
#: Braking moves the mass by so many of the answer's standard uncertainties.
_BRAKING: Final = 1.5


def wheel_radius(case: Case) -> list[Sign]:
    """The wheels' speed against the accelerometer's: a radius is in the force as well."""
    wheels = None if case.fit is None else case.fit.kinematics
    if wheels is None or not wheels.goes_together:
        return []
    gain, std = wheels.gain
    strength = abs(gain) / max(_GAIN_DEVIATIONS * std, _LEAST_GAIN)
    body = case.machine.machine
    setting, value = [], []
    if body.wheel_radius_m is not None:
        setting, value = ["machine.wheel_radius_m"], [f"{body.wheel_radius_m / (1.0 + gain):.5g}"]
    keys, scales = case.scaled(case.speed_channels, 1.0 / (1.0 + gain))
    torques = bool(case.measured("torque_left_N_m", "torque_right_N_m"))

    def larger(motion: Equation) -> Equation:
        force = motion.force * (1.0 + gain) if torques else motion.force
        return replace(motion, force=force, speed=motion.speed / (1.0 + gain))

    return [
        Sign(
            strength,
            f"the wheels' speed changes by {gain:+.2%} ± {std:.2%} more than the accelerometer "
            "says: their radius, or the accelerometer's scale",
            channel=next(iter(case.speed_channels), None),
            setting=", ".join([*setting, *([keys] if keys else [])]) or None,
            value=", ".join([*value, *([scales] if keys else [])]) or None,
            change=lambda: mended(case, larger, min(std / abs(gain), 1.0)),
        )
    ]


def offset(case: Case) -> list[Sign]:
    """A force while the machine stands, which driving has as well."""
    rest, std = case.level_of(longitudinal_force(case.aligned, case.machine.machine))
    if not np.isfinite(rest):
        return _constant_alone(case)
    fit = case.fit
    largest = fit.motion.largest_force if fit is not None else np.nan
    strength = abs(rest) / max(_AT_REST * std, _LEAST_OFFSET * np.nan_to_num(largest))
    const, const_std = constant(case)
    if fit is not None:
        # what it holds while it stands may be its brakes', and not be there when it drives
        error, _ = standing_error(case)
        driving = const + fit.mass_kg * float(np.nan_to_num(error))
        if ((driving - rest) / const_std) ** 2 > (driving / const_std) ** 2 + _APART:
            return []
    names = case.measured("force_x_N") or case.measured("torque_left_N_m", "torque_right_N_m")
    at_rest = [case.level(name)[0] for name in names]
    return [
        Sign(
            float(strength),
            f"standing, it reads {rest:+.0f} ± {std:.0f} N; driving has {const:+.0f} ± "
            f"{const_std:.0f} N besides mass and friction",
            channel=case.force_channel,
            setting=", ".join(f"channels.{name}.offset" for name in names) or None,
            value=", ".join(_zeroed(case, name, x) for name, x in zip(names, at_rest, strict=True))
            or None,
            change=lambda: mended(
                case,
                lambda motion: replace(motion, force=motion.force - rest),
                min(std / abs(rest), 1.0),
            ),
        )
    ]


def _zeroed(case: Case, name: str, reads: float) -> str:
    channel = case.machine.channels[name]
    if channel.unit is None:
        return f"{channel.offset - reads:.6g}"
    from analysis.schema import CHANNEL_COLUMNS
    from analysis.units import to_si

    unit = next(column.unit for column in CHANNEL_COLUMNS if column.name == name)
    gain, _ = to_si(channel.unit, unit)
    return f"{channel.offset - reads / gain:.6g}"


def _constant_alone(case: Case) -> list[Sign]:
    """A constant force of a log that never stands: nothing tells whose it is."""
    const, std = constant(case)
    if not np.isfinite(const):
        return []
    return [
        Sign(
            abs(const) / (_TERM * std),
            f"driving has {const:+.0f} ± {std:.0f} N besides mass and friction",
            channel=case.force_channel,
            alternatives=("imu_misaligned", "imu_bias", "slope", "coulomb"),
        )
    ]


def coulomb(case: Case) -> list[Sign]:
    """A force against the motion that does not depend on it."""
    fit = case.fit
    if fit is None:
        return []
    names = [term.name for term in fit.terms]
    found, stds = fit.posterior
    alternatives: tuple[str, ...] = ()
    if "direction" in names:
        place = names.index("direction")
        force, std = float(found[place]), float(stds[place])
    else:
        const, std = constant(case)
        error, error_std = standing_error(case)
        rest, rest_std = case.level_of(longitudinal_force(case.aligned, case.machine.machine))
        known = [np.isfinite(rest), np.isfinite(error)]
        force = const - np.nan_to_num(rest) + fit.mass_kg * np.nan_to_num(error)
        std = float(
            np.linalg.norm([std, np.nan_to_num(rest_std), fit.mass_kg * np.nan_to_num(error_std)])
        )
        force *= float(np.median(fit.motion.direction[fit.motion.used]))
        alternatives = () if all(known) else ("offset", "imu_misaligned", "imu_bias")
    if force <= 0.0:
        return []
    return [
        Sign(
            force / (_TERM * std),
            f"{force:.0f} ± {std:.0f} N oppose the motion at any speed",
            setting="settings.forces.coulomb",
            value="true",
            # the answer's fit has the term: only the paper's estimates gain it
            change=lambda: _none(case),
            alternatives=alternatives,
        )
    ]


def _none(case: Case) -> Change | None:
    fit = case.fit
    return None if fit is None else Change(0.0, 0.3 * fit.u_kg)


def slip(case: Case) -> list[Sign]:
    """Wheels that turn faster than the ground under force, by the accelerometer."""
    wheels = None if case.fit is None else case.fit.kinematics
    if wheels is None or case.fit is None or not wheels.goes_together:
        return []
    slip_1_N, std = wheels.slip_1_N
    if slip_1_N <= 0.0:
        return []
    at = slip_1_N * case.fit.motion.largest_force
    return [
        Sign(
            slip_1_N / (_TERM * std),
            f"the wheels slip by {at:.2%} ± {at * std / slip_1_N:.2%} of their speed at full force",
            channel=next(iter(case.speed_channels), None),
            change=lambda: _none(case),
        )
    ]


def driveline(case: Case) -> list[Sign]:
    """A force that is not linear in the acceleration: load transfer, or losses of the drive."""
    weighing, fit = case.evidence.weighing, case.fit
    if weighing is None or fit is None:
        return []
    bends = weighing.curvature
    strength = abs(bends.t) / _CURVED
    said = f"a force in a·|a| is {bends.t:+.1f} deviations from 0"
    if "load_transfer" in fit.terms_t:
        t = fit.terms_t["load_transfer"]
        said += f", the measured wheels' share changes by {t:.1f}"
        strength = max(strength, t / _CURVED)
    return [Sign(strength, said, channel=case.force_channel)]


def too_little(case: Case) -> list[Sign]:
    """No accepted stretch, or an answer that is hardly one."""
    weighing = case.evidence.weighing
    if weighing is None:
        stretches = case.checks.get("accepted_stretches", 0.0)
        return [Sign(2.0, f"{stretches:.0f} stretches were accepted: there is nothing to fit")]
    share = weighing.fit.u_kg / abs(weighing.fit.mass_kg)
    return [Sign(share / _POOR, f"the answer's standard uncertainty is {share:.1%} of it")]


def collinear(case: Case) -> list[Sign]:
    """Terms that the motion does not tell from the mass."""
    fit = case.fit
    if fit is None:
        return []
    parts = fit.parts_kg(fit.weights(fit.main))
    by_term = {term.name: parts[term.name] for term in fit.terms}
    worst = max(by_term, key=lambda name: by_term[name])
    share = float(np.linalg.norm(list(by_term.values()))) / abs(fit.mass_kg)
    return [
        Sign(
            share / _OPEN,
            f"the motion leaves {share:.1%} of the mass to priors, most of it to {worst}",
        )
    ]


def braking(case: Case) -> list[Sign]:
    """Braking that counts as driving, and moves the mass."""
    weighing = case.evidence.weighing
    if weighing is None or not np.isfinite(weighing.braking_kg):
        return []
    strength = abs(weighing.braking_kg) / (_BRAKING * weighing.fit.u_kg)
    left = 0.0 if weighing.braking_left_out else -weighing.braking_kg
    return [
        Sign(
            float(strength),
            f"braking moves the mass by {weighing.braking_kg:+.0f} kg: the force does not see all "
            "of the brakes",
            setting="settings.gate.exclude_braking",
            value="true",
            change=lambda: Change(left, 0.5 * weighing.fit.u_kg),
        )
    ]


def external_force(case: Case) -> list[Sign]:
    """Starts against something that pushes back."""
    if not case.digs.height:
        return []
    growth, std = (case.digs[name].to_numpy() for name in ("growth_N", "growth_std_N"))
    worst = int(np.argmax(growth / std))
    begin, end = (int(case.digs[name][worst]) for name in ("start_t_ns", "end_t_ns"))
    return [
        Sign(
            float(growth[worst] / std[worst]) / 5.0 * np.sqrt(case.digs.height),
            f"in {case.digs.height} starts a resistance grows, by up to {growth[worst]:.0f} ± "
            f"{std[worst]:.0f} N; they are left out",
            channel=case.force_channel,
            span_ns=(begin, end),
            change=lambda: _none(case),
        )
    ]


def load_changed(case: Case) -> list[Sign]:
    """Manoeuvres whose load grows or falls while they drive."""
    weighing = case.evidence.weighing
    if weighing is None or not weighing.growing:
        return []
    worst = max(weighing.growing, key=lambda each: abs(each.kg) / each.std_kg)
    t = case.aligned["t_ns"].to_numpy()
    begin = int(t[min(worst.first, t.size - 1)])
    return [
        Sign(
            abs(worst.kg) / worst.std_kg / 4.0 * float(np.sqrt(len(weighing.growing))),
            f"in {len(weighing.growing)} manoeuvres the load changes, by up to {worst.kg:+.0f} ± "
            f"{worst.std_kg:.0f} kg; they are left out",
            span_ns=(begin, begin),
            change=lambda: _none(case),
        )
    ]
