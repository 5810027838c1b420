"""What the plant is made of: body, ground and drive train."""

from typing import Final, NamedTuple

GRAVITY_M_S2: Final = 9.80665


class Plant(NamedTuple):
    """Body, ground and drive train.

    Attributes:
        mass_kg: without load.
        viscous_N_s_m: friction in proportion to the speed, when cold.
        warming_share: share of it that is gone at the end of the log.
        warming_s: when that is.
        coulomb_N: dry friction.
        rolling_1: rolling resistance over the weight, before `rolling_split_m`,
        rolling_far_1: and behind it.
        rolling_split_m: where the ground changes, over a metre.
        rolling_speed_s_m: by what share it grows per m/s.
        quadratic_N_s2_m2: loss in proportion to v·|v|.
        slope_rad: of the whole ground, rising up the track.
        hills_rad: amplitude of a sine on it,
        hills_length_m: its length
        hills_phase_rad: and phase.
        force_max_N: at full throttle.
        drive_lag_s: time constant of the drive force.
        brake_lag_s: time constant of the brakes.
        stick_share: amplitude of the operator's hand on the throttle,
        stick_hz: and its frequency.
        squat_s2_m: pitch (rad) per m/s² of an empty machine, nose up,
        squat_by_mass: 1 where it grows with the mass, 0 where not.
        sag_rad_kg: nose down per kilogram of load.
        pitch_hz: natural frequency of the body on its springs,
        pitch_damping: and damping ratio.
        pile_N_m: growth of the pile's resistance,
        pile_N_m2: which grows itself.
        pile_full_m: penetration that fills the bucket.
    """

    mass_kg: float
    viscous_N_s_m: float
    force_max_N: float
    warming_share: float = 0.0
    warming_s: float = 1.0
    coulomb_N: float = 0.0
    rolling_1: float = 0.0
    rolling_far_1: float = 0.0
    rolling_split_m: float = 0.0
    rolling_speed_s_m: float = 0.0
    quadratic_N_s2_m2: float = 0.0
    slope_rad: float = 0.0
    hills_rad: float = 0.0
    hills_length_m: float = 50.0
    hills_phase_rad: float = 0.0
    drive_lag_s: float = 0.12
    brake_lag_s: float = 0.08
    stick_share: float = 0.0
    stick_hz: float = 0.7
    squat_s2_m: float = 0.0
    squat_by_mass: float = 0.0
    sag_rad_kg: float = 0.0
    pitch_hz: float = 2.2
    pitch_damping: float = 0.45
    pile_N_m: float = 0.0
    pile_N_m2: float = 0.0
    pile_full_m: float = 1.0
