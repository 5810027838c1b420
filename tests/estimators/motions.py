"""The five motions whose identifiable parameters are known, as exact samples of 20 s at 100 Hz."""

import numpy as np

from estimators.planar import planar_rows, rigid_body

#: A loader, in the order of planar_rows.PARAMETERS.
LOADER = np.array([3614.0, 4200.0, 500.0, -60.0, 2891.0, 1500.0])

T_S = np.arange(2000) / 100.0


def triangle(period_s, amplitude, offset):
    """A triangle and its slope: a constant force through first-order friction is close to it."""
    share = (T_S % period_s) / period_s
    slope = np.where(share < 0.5, 1.0, -1.0) * 2.0 * amplitude / period_s
    return offset + amplitude * np.where(share < 0.5, 2.0 * share, 2.0 - 2.0 * share), slope


def channels(speed, speed_dot, yaw_rate, yaw_acceleration, origin_x=0.0):
    """Specific force on level ground, speed, yaw rate and acceleration of the origin.

    `origin_x` is where the origin lies from the centre that the machine turns about, along x.
    """
    return {
        "specific_force_x": speed_dot - yaw_rate**2 * origin_x,
        "specific_force_y": yaw_rate * speed + yaw_acceleration * origin_x,
        "speed": speed,
        "yaw_rate": yaw_rate,
        "yaw_acceleration": yaw_acceleration,
    }


def straight():
    return channels(*triangle(7.0, 1.5, 0.1), np.zeros(2000), np.zeros(2000))


def spin(origin_x=0.0):
    return channels(np.zeros(2000), np.zeros(2000), *triangle(5.0, 0.8, -0.2), origin_x)


def constant_arc():
    return channels(np.full(2000, 1.2), np.zeros(2000), np.full(2000, 0.4), np.zeros(2000))


def joint():
    return channels(*triangle(7.0, 1.5, 0.1), *triangle(5.0, 0.8, -0.2))


MOTIONS = {
    "straight": straight(),
    "spin about the origin": spin(),
    "spin about an offset centre": spin(-0.2),
    "one constant arc": constant_arc(),
    "joint": joint(),
}


def spatial(motion, lateral_speed=None):
    """The (n, 6, 16) regressor (5) of a motion on level ground."""
    zero = np.zeros(2000)
    lateral = zero if lateral_speed is None else lateral_speed
    return rigid_body.make_rigid_body_regressor(
        np.column_stack([zero, zero, motion["yaw_rate"]]),
        np.column_stack([zero, zero, motion["yaw_acceleration"]]),
        np.column_stack([motion["speed"], lateral, zero]),
        np.column_stack([motion["specific_force_x"], motion["specific_force_y"], zero + 9.81]),
    )


def measured(motion, noise, generator, mean):
    """A motion with white noise on every channel (a mapping of r.m.s.), after a moving mean."""
    kernel = np.ones(mean) / mean
    return {
        name: np.convolve(x + noise[name] * generator.normal(size=x.size), kernel, "valid")
        for name, x in motion.items()
    }


def forces(motion, parameters=LOADER):
    return planar_rows.make_planar_regressor(**motion) @ parameters
