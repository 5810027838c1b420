"""The table of nuisance terms: the parts of a real machine's force besides m a + b v.

Each term has a column, a prior whose width scales with the machine, and a description. Prior means
are 0 unless a calibration learnt other ones (`settings.priors.learnt`).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Self

import numpy as np

from analysis.model.prior_settings import PriorSettings
from analysis.weighing.column_inputs import ColumnInputs
from analysis.weighing.friction_warming import WARMING
from analysis.weighing.motion_samples import Floats, MotionSamples
from analysis.weighing.weighing_limits import LIMITS


@dataclass(frozen=True, slots=True)
class Nuisance:
    """A nuisance term of the fit.

    Attributes:
        name: name in frames, settings and answers.
        unit: unit of its parameter.
        column: computes its column, (n,).
        compute_prior_std: computes the default prior standard deviation.
        meaning: what it models, in a sentence.
        reduced_by: what would reduce its uncertainty.
        by_speed: derivative of the column with respect to the speed, which propagates the noise of
            the speed; None if the column does not depend on the speed.
        by_force: derivative with respect to the force, likewise.
        by_acceleration: derivative with respect to the acceleration, likewise.
        by_force_rate: derivative with respect to the derivative of the force, likewise.
        by_force_bend: derivative with respect to the second derivative of the force, likewise.
        applies: whether the term applies to a log.
        by_load: whether the term needs several load states.
        source: budget entry that combines this term with others; "" if it has its own entry.
        prior_keys: keys of `settings.priors` that set its prior.
    """

    name: str
    unit: str
    column: Callable[[ColumnInputs], Floats]
    compute_prior_std: Callable[[MotionSamples, PriorSettings], float]
    meaning: str
    reduced_by: str
    by_speed: Callable[[ColumnInputs], Floats] | None = None
    by_force: Callable[[ColumnInputs], Floats] | None = None
    by_acceleration: Callable[[ColumnInputs], Floats] | None = None
    by_force_rate: Callable[[ColumnInputs], Floats] | None = None
    by_force_bend: Callable[[ColumnInputs], Floats] | None = None
    applies: Callable[[MotionSamples], bool] = lambda _: True
    by_load: bool = False
    source: str = ""
    prior_keys: tuple[str, ...] = ()


def compute_constant_force_prior_std_newtons(
    largest_force_N: float, weight_N: float, priors: PriorSettings
) -> float:
    """Prior standard deviation of a constant force in N, from driving force and weight."""
    by_weight_N = priors.const_weight_share * weight_N
    return float(np.hypot(priors.const_share * largest_force_N, by_weight_N))


def compute_friction_prior_std_newtons(
    largest_force_N: float, weight_N: float, priors: PriorSettings
) -> float:
    """Prior standard deviation of Coulomb friction and rolling resistance in N.

    Combined from a share of the driving force and a share of the weight.
    """
    by_weight_N = priors.direction_weight_share * weight_N
    return float(np.hypot(priors.direction_share * largest_force_N, by_weight_N))


def compute_constant_force_prior_std_of_motion_newtons(
    motion: MotionSamples, priors: PriorSettings
) -> float:
    """Prior standard deviation of the term `const`, in N."""
    return compute_constant_force_prior_std_newtons(
        motion.force_95_percentile_newtons, motion.empty_weight_N, priors
    )


def compute_friction_prior_std_of_motion_newtons(
    motion: MotionSamples, priors: PriorSettings
) -> float:
    """Prior standard deviation of the Coulomb term, in N."""
    return compute_friction_prior_std_newtons(
        motion.force_95_percentile_newtons, motion.empty_weight_N, priors
    )


def estimate_error_fraction_and_std_of_constant(
    motion: MotionSamples, priors: PriorSettings
) -> tuple[float, float]:
    """Fraction of a constant force that is measurement error, and the std of that split in N.

    Both follow from the priors: the log determines only the sum of error and acting force.
    """
    wrong = priors.const_share * motion.force_95_percentile_newtons
    coulomb = (
        0.0
        if motion.drives_both_ways
        else compute_friction_prior_std_of_motion_newtons(motion, priors)
    )
    acts = float(np.hypot(priors.const_weight_share * motion.empty_weight_N, coulomb))
    both = float(np.hypot(wrong, acts))
    return ((wrong / both) ** 2, wrong * acts / both) if both else (0.0, 0.0)


@dataclass(frozen=True, slots=True)
class LoadProportionalShare:
    """Fraction of a force that is proportional to the weight, by the priors alone.

    Offset and Coulomb friction are equal for all loads; tilt, accelerometer bias, slope and rolling
    resistance grow with the load.

    Attributes:
        expected: expected fraction at the reference load.
        std_N: standard deviation of the part that is proportional to the weight, in N.
    """

    expected: float
    std_N: float

    @classmethod
    def from_parts(cls, constant_std_N: float, weight_std_N: float) -> Self:
        """Split the sum of two forces with these prior standard deviations in N."""
        both = float(np.hypot(constant_std_N, weight_std_N))
        return cls((weight_std_N / both) ** 2, constant_std_N * weight_std_N / both)


def estimate_load_proportional_share_of_constant(
    motion: MotionSamples, priors: PriorSettings
) -> LoadProportionalShare:
    """Split the constant force, which includes friction if all driving is in one direction."""
    newtons = priors.const_share * motion.force_95_percentile_newtons
    of_weight = priors.const_weight_share * motion.empty_weight_N
    if motion.drives_both_ways:
        return LoadProportionalShare.from_parts(newtons, of_weight)
    return LoadProportionalShare.from_parts(
        float(np.hypot(newtons, priors.direction_share * motion.force_95_percentile_newtons)),
        float(np.hypot(of_weight, priors.direction_weight_share * motion.empty_weight_N)),
    )


def estimate_load_proportional_share_of_coulomb(
    motion: MotionSamples, priors: PriorSettings
) -> LoadProportionalShare:
    """Split the friction force that opposes the direction of motion."""
    return LoadProportionalShare.from_parts(
        priors.direction_share * motion.force_95_percentile_newtons,
        priors.direction_weight_share * motion.empty_weight_N,
    )


def compute_weight_proportional_force_prior_std_newtons(
    motion: MotionSamples, priors: PriorSettings
) -> float:
    """Prior standard deviation of `weight_const` in N, by its split and by a sagging body."""
    sags = priors.sag_weight_share * motion.empty_weight_N
    return float(np.hypot(estimate_load_proportional_share_of_constant(motion, priors).std_N, sags))


def _make_warming_term(name: str) -> Nuisance:
    """Make the term of viscous friction that changes as the oil warms."""
    shape = WARMING[name]
    return Nuisance(
        name,
        "N·s/m",
        lambda m: m.speed * shape.share(m.progress),
        lambda e, s: (
            s.viscous_drift_share * e.force_95_percentile_newtons / e.speed_95_percentile_m_s
        ),
        shape.meaning,
        "a machine that is warm",
        by_speed=lambda m: shape.share(m.progress),
        applies=lambda e: e.manoeuvre_count > shape.degree,
        # with a single load, a cubic cannot be distinguished from the mass
        by_load=shape.degree > 2,
        prior_keys=("viscous_drift_share",),
    )


#: All terms, in the order of the fit's parameters; a fit uses those that apply to its log.
NUISANCES: Final = (
    Nuisance(
        "const",
        "N",
        lambda m: 1.0 + m.weight_shares[0] * m.relative_load,
        compute_constant_force_prior_std_of_motion_newtons,
        "a constant force: offset of the force, tilt or bias of the accelerometer, slope; "
        "Coulomb friction where all driving is one way",
        "starts in both directions, or at different throttles",
        prior_keys=("const_share", "const_weight_share"),
    ),
    Nuisance(
        "lag",
        "s",
        lambda m: -m.force_rate,
        lambda _, s: s.lag_s,
        "delay of the force relative to the motion",
        "sharper starts, or clocks that are synchronised",
        prior_keys=("lag_s",),
        by_force_rate=lambda m: -np.ones(m.speed.size),
    ),
    Nuisance(
        "lag_drift",
        "s",
        lambda m: -m.force_rate * m.progress,
        lambda _, s: s.lag_drift_s,
        "growth of the delay of the force over the log: clocks that drift apart",
        "clocks that are synchronised",
        by_force_rate=lambda m: -m.progress,
        prior_keys=("lag_drift_s",),
    ),
    Nuisance(
        "slip",
        "s/m",
        lambda m: np.abs(m.ground_speed_m_s) * m.force,
        lambda e, s: s.wheel_slip / e.speed_95_percentile_m_s,
        "longitudinal slip: friction of a wheel speed that is not the ground's",
        "an accelerometer beside the wheel speed, or starts at different throttles",
        by_speed=lambda m: np.sign(m.speed) * m.force,
        by_force=lambda m: np.abs(m.speed),
        prior_keys=("wheel_slip",),
    ),
    Nuisance(
        "slip_acceleration",
        "kg/N",
        lambda m: (
            -(1.0 + m.relative_load)
            * m.ground_speed_ratio
            * (
                np.sign(m.speed) * m.wheel_acceleration * m.force
                + np.abs(m.ground_speed_m_s) * m.force_rate
            )
        ),
        lambda e, s: e.approximate_mass_kg * s.wheel_slip / e.force_95_percentile_newtons,
        "longitudinal slip: the wheels gain more speed than the machine",
        "an accelerometer on the body",
        by_force=lambda m: -np.sign(m.speed) * m.wheel_acceleration,
        by_acceleration=lambda m: -np.sign(m.speed) * m.force,
        by_force_rate=lambda m: (
            -(1.0 + m.relative_load) * m.ground_speed_ratio**2 * np.abs(m.speed)
        ),
        applies=lambda e: e.wheel_acceleration is not None,
        prior_keys=("wheel_slip",),
    ),
    Nuisance(
        "quadratic",
        "N·s²/m²",
        lambda m: m.speed * np.abs(m.speed),
        lambda e, s: (
            s.quadratic_share * e.force_95_percentile_newtons / e.speed_95_percentile_m_s**2
        ),
        "resistance that grows with the square of the speed",
        "cruising at several speeds",
        by_speed=lambda m: 2.0 * np.abs(m.speed),
        prior_keys=("quadratic_share",),
    ),
    Nuisance(
        "direction",
        "N",
        lambda m: m.direction * (1.0 + m.weight_shares[1] * m.relative_load),
        compute_friction_prior_std_of_motion_newtons,
        "Coulomb friction, where the log drives both ways",
        "starts at different throttles",
        applies=lambda e: e.drives_both_ways,
        prior_keys=("direction_share", "direction_weight_share"),
    ),
    Nuisance(
        "load_transfer",
        "s²/m",
        lambda m: m.acceleration * m.force,
        lambda _, s: s.load_transfer_s2_m,
        "the measured wheels' share of the force changes with the acceleration",
        "force measured on all wheels, or starts at different throttles",
        by_force=lambda m: m.acceleration,
        by_acceleration=lambda m: m.force,
        applies=lambda e: e.force_share < 1.0,
        prior_keys=("load_transfer_s2_m",),
    ),
    Nuisance(
        "offset",
        "N",
        lambda m: -m.slip_s_m * np.abs(m.speed) - m.load_transfer_s2_m * m.acceleration,
        lambda e, s: max(
            estimate_error_fraction_and_std_of_constant(e, s)[1], LIMITS.min_offset_std_N
        ),
        "part of the constant force that is an error of the measured force, less its expected "
        "value: neither slip nor load transfer changes it",
        "a force sensor that is zeroed",
        by_speed=lambda m: -m.slip_s_m * np.sign(m.speed),
        by_acceleration=lambda m: np.full(m.speed.size, -m.load_transfer_s2_m),
    ),
    *map(_make_warming_term, WARMING),
    Nuisance(
        "gain_drift",
        "1",
        lambda m: m.force * m.progress,
        lambda _, s: s.gain_drift,
        "how much the gain of the force changes over the log",
        "loads that come back: empty, loaded, empty",
        by_force=lambda m: m.progress,
        applies=lambda e: e.manoeuvre_count > 1,
        prior_keys=("gain_drift",),
    ),
    Nuisance(
        "weight_const",
        "N",
        lambda m: m.relative_load,
        compute_weight_proportional_force_prior_std_newtons,
        "part of the constant force that is proportional to the loaded weight (tilt or bias of the "
        "accelerometer, slope), less its expected value",
        "starts at different throttles with each load; an accelerometer that is zeroed",
        by_load=True,
        prior_keys=("sag_weight_share", "const_weight_share"),
    ),
    Nuisance(
        "weight_direction",
        "N",
        lambda m: m.direction * m.relative_load,
        lambda e, s: estimate_load_proportional_share_of_coulomb(e, s).std_N,
        "part of Coulomb friction that is proportional to the loaded weight (rolling resistance), "
        "less its expected value",
        "starts at different throttles with each load",
        applies=lambda e: e.drives_both_ways,
        by_load=True,
        prior_keys=("direction_weight_share",),
    ),
    Nuisance(
        "weight_viscous",
        "N·s/m",
        lambda m: m.speed * m.relative_load,
        lambda e, s: s.viscous_weight_share_s_m * e.empty_weight_N,
        "viscous friction that is proportional to the loaded weight: rolling resistance "
        "that grows with the speed",
        "cruising at several speeds with each load",
        by_speed=lambda m: m.relative_load,
        by_load=True,
        prior_keys=("viscous_weight_share_s_m",),
    ),
)

#: Almost free term by which a check tests whether the force is linear in the acceleration.
CURVATURE: Final = Nuisance(
    "curvature",
    "N·s⁴/m²",
    lambda m: m.acceleration * np.abs(m.acceleration),
    lambda _, __: 1e9,
    "a force that is not linear in the acceleration",
    "force measured on all wheels; a force sensor that measures all braking",
    by_acceleration=lambda m: 2.0 * np.abs(m.acceleration),
)
#: Almost free term by which a check tests whether the load grows equally at every start. The added
#: mass is brought to the machine's speed.
FILLING: Final = Nuisance(
    "filling",
    "kg/s",
    lambda m: m.acceleration * m.under_way_s + m.speed,
    lambda _, __: 1e9,
    "a load that grows while the machine drives",
    "starts that begin and end with the same load",
    by_speed=lambda m: np.ones_like(m.speed),
    by_acceleration=lambda m: m.under_way_s,
)
