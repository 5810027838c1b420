"""Logs without noise, all topics sampled at the same instants."""

from analysis.simulation import Scenario, simulate_campaign
from analysis.simulation.drive.log_drive import drive_trials_of_log

NO_NOISE = {
    "force_noise_N": 0.0,
    "acc_noise_m_s2": 0.0,
    "speed_noise_m_s": 0.0,
    "gyro_noise_rad_s": 0.0,
    "pitch_noise_rad": 0.0,
}
#: So that their rows belong together.
TOGETHER = {"imu_phase_s": 0.0, "torque_phase_s": 0.0, "speed_phase_s": 0.0}
MASS_KG, FRICTION_N_S_M, G = 3614.0, 2891.0, 9.80665


def scenario(**sections):
    """One load, one run, a second's rest; what is given comes on top."""
    campaign = {"loads_kg": [0], "runs": 1, "standstill_s": 1.0, "rest_s": 1.0}
    given = {
        "campaign": {**campaign, **sections.pop("campaign", {})},
        "sensors": {**NO_NOISE, **sections.pop("sensors", {})},
        "sampling": {**TOGETHER, **sections.pop("sampling", {})},
    }
    return Scenario.model_validate({**given, **sections})


def log(**sections):
    """The first log of such a scenario."""
    return next(simulate_campaign(scenario(**sections)))


def drive(load_kg=0.0, **sections):
    """The motion of such a log as the integrated plant has it."""
    return drive_trials_of_log(scenario(**sections), load_kg, 0)


def total_force(made):
    """The force that (17) makes of both torques."""
    machine = made.scenario.machine
    torque = made.topics["torque"]
    total = (torque["torque_left_N_m"] + torque["torque_right_N_m"]).to_numpy()
    return total / machine.wheel_radius_m / machine.force_share


def mean_speed(made):
    """The mean speed of both sides."""
    speed = made.topics["speed"]
    return ((speed["speed_left_m_s"] + speed["speed_right_m_s"]) / 2.0).to_numpy()
