"""Compile in advance the loops of runs, reviews and simulations, by running small ones.

Compiled code depends on the types of arrays and on the container of a log, not on its length.
"""

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from analysis.model.methods import METHODS
from analysis.online.follower import FollowedRow
from analysis.simulation import Scenario
from analysis.simulation.scenario.shift_plan import SimulatedShift
from estimators.interpreted import compile_even_short_loops
from replay.follow.follow_logs import FollowedLogState, follow_logs
from replay.machines.machine_file import load_machine
from replay.machines.toml_file import format_toml
from replay.review.review_shift import ReviewOptions, review_shift
from replay.runs.run_logs import replay_and_record_logs
from replay.simulation.simulate_logs import simulate_scenario_to_logs

_CONTAINERS: Final = (".bag", ".mcap", ".db3")
#: Names with which `on_stage` is called, in order.
STEPS: Final = (
    *("simulate", *(each[1:] for each in _CONTAINERS)),
    *("rates", "turns", "follow", "review"),
)
_MACHINE: Final = Path("cat262c.toml")
_ALL_METHODS: Final = f"settings.trace.methods={format_toml([*METHODS])}"
_BY_WHEELS: Final = (
    "channels.acc_x_m_s2.derive=d/dt speed_x_m_s",
    "settings.forces.acceleration=kinematic",
)
#: Two starts in half a minute, at half the usual rate: the least that a fit needs.
_STRAIGHT: Final = {
    "campaign": {
        "loads_kg": [150],
        "runs": 2,
        "standstill_s": 2.0,
        "start_s": 3.0,
        "cruise_s": 2.0,
        "rest_s": 1.5,
    },
    "sensors": {"rate_hz": 50.0},
}
#: The same with wheels slower than the grid, and with all channels faster, so that both are
#: averaged.
_OTHER_RATES: Final = {
    "slow": {**_STRAIGHT, "sampling": {"torque_rate_hz": 8.0, "speed_rate_hz": 8.0}},
    "fast": {**_STRAIGHT, "sensors": {"rate_hz": 400.0}},
}
#: A start in each direction, a spin and an arc, with dropped samples.
_TURNING: Final = {
    "campaign": {
        "loads_kg": [250],
        "runs": 1,
        "manoeuvres": [
            {"kind": "rest", "duration_s": 1.0},
            {"kind": "start"},
            {"kind": "start", "direction": "reverse", "throttle": 0.8},
            {"kind": "spin"},
            {"kind": "arc", "speed_m_s": 0.8, "yaw_rate_rad_s": 0.3, "duration_s": 6.0},
        ],
    },
    "sensors": {"rate_hz": 50.0, "imu_x_m": 0.4},
    "log": {"dropout_share": 0.002},
}
_SHIFT: Final = SimulatedShift(duration_h=0.1, logs=2)


def compile_all_loops(on_stage: Callable[[str], None] = lambda _: None) -> None:
    """Compile all loops into their caches; cached ones are only loaded.

    Args:
        on_stage: called with the name of each of `STEPS` as it begins.
    """
    with compile_even_short_loops(), TemporaryDirectory(prefix="payscope-warm-up-") as made:
        folder = Path(made)
        on_stage("simulate")
        straight = Scenario.model_validate(_STRAIGHT)
        turning = simulate_scenario_to_logs(
            Scenario.model_validate(_TURNING), folder / "turning.mcap"
        )
        hauling = Scenario().model_copy(update={"shift": _SHIFT})
        shift = simulate_scenario_to_logs(hauling, folder / "shift.mcap")
        for suffix in _CONTAINERS:
            on_stage(suffix[1:])
            logs = simulate_scenario_to_logs(straight, folder / f"straight{suffix}")
            replay_and_record_logs(logs, _MACHINE, overrides=[_ALL_METHODS])
        on_stage("rates")
        for name, keys in _OTHER_RATES.items():
            scenario = Scenario.model_validate(keys)
            replay_and_record_logs(
                simulate_scenario_to_logs(scenario, folder / f"{name}.mcap"), _MACHINE
            )
        on_stage("turns")
        replay_and_record_logs(turning, _MACHINE)
        on_stage("follow")
        follow_logs(turning, load_machine(_MACHINE), _discard_followed_rows, idle_s=0.0)
        on_stage("review")
        review_shift(shift, _MACHINE, folder / "page", ReviewOptions())
        # without an accelerometer, a mass that swings is searched for
        replay_and_record_logs(shift, _MACHINE, overrides=_BY_WHEELS)


def _discard_followed_rows(following: FollowedLogState, rows: list[FollowedRow]) -> None:
    del following, rows
