"""Design an excitation (sections 3.1 and 4.2 of the paper): the best waveform for one window.

The response time T is that of the model's step response, the period T_f = 3 T lets it settle, and
the window T_φ lies between the two. Each waveform drives the model; the window is scored at the
position in the period where it determines the parameters least.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal, TypeAlias, get_args

import numpy as np

from analysis.excitation.error_prediction import (
    Drive,
    ErrorPrediction,
    Filters,
    MeasuredSignals,
    compute_sensor_noise_stds,
    predict_estimate_errors_of_drive,
    predict_noise_scaled_condition_number,
)
from analysis.simulation import Channels, Scenario, solve_motion
from analysis.simulation.motion.body import RigidBody
from analysis.simulation.scenario.manoeuvres import Excite, Rest
from analysis.simulation.scenario.waveforms import ForceWave, Shape, TorqueWave
from estimators.errors import DataError
from estimators.planar import planar_rows
from estimators.planar.identifiability import find_identifiable_parameters

Axis: TypeAlias = Literal["force", "torque"]
Ways: TypeAlias = Literal["one way", "both ways"]

#: Relative deviation from the final value within which a step response has settled.
_SETTLED: Final = 0.02
_PERIOD_OVER_RESPONSE: Final = 3.0
#: Smallest ratio of the periods: in step, speed and yaw rate could not separate mass and moment.
_LEAST_PERIOD_RATIO: Final = 1.2
_OUT_OF_STEP: Final = 2.0 / 3.0
#: Relative accuracy of a solved motion: smaller variation is no information.
_SOLVED_TO: Final = 1e-9
#: Number of positions of the window in a period.
_PLACES: Final = 24
_SMOOTH_SAMPLES: Final = 10
_AXES: Final[dict[Drive, tuple[Axis, ...]]] = {
    "straight": ("force",),
    "spin": ("torque",),
    "joint": ("force", "torque"),
}
#: Quantities that must reach the wanted accuracy, by drive.
_ASKED: Final[dict[Drive, tuple[str, ...]]] = {
    "straight": ("mass_kg",),
    "spin": ("inertia_z_kg_m2",),
    "joint": ("mass_kg", "inertia_z_kg_m2"),
}


@dataclass(frozen=True)
class WaveformScore:
    """Predicted errors of one waveform, from the window that determines the parameters least.

    Attributes:
        waveform: shape of the waveform.
        ways: "one" (force and torque never oppose the motion) or "both".
        manoeuvre: manoeuvre that drives the waveform.
        start_s: start of the window, including the samples that the filters need before it.
        predictions: predictions by name: `mass_kg`, `inertia_z_kg_m2`, `com_x_m`.
        rank: number of the six parameters of the planar regressor that are determined.
        condition: condition number of AᵀA, with each column divided by its noise.
        snr: standard deviation over a period of the applied force (of the torque in a spin),
            divided by the noise of one of its samples.
        snr_needed: smallest SNR that reaches the accuracy; None if bias or other noise prevents it.
        peak_speed_m_s: highest speed.
        reach_m: largest distance from the start before braking.
        relative_error: largest relative r.m.s. error of the wanted quantities.
    """

    waveform: Shape
    ways: Ways
    manoeuvre: Excite
    start_s: float
    predictions: Mapping[str, ErrorPrediction]
    rank: int
    condition: float
    snr: float
    snr_needed: float | None
    peak_speed_m_s: float
    reach_m: float
    relative_error: float

    def to_dict(self) -> dict[str, Any]:
        """The score as plain values."""
        manoeuvre = self.manoeuvre.model_dump(exclude_none=True)
        return {
            "force": manoeuvre.get("force"),
            "torque": manoeuvre.get("torque"),
            "duration_s": self.manoeuvre.duration_s,
            "window_start_s": self.start_s,
            "predictions": {
                name: {
                    "value": each.value,
                    "std": each.predicted_error_std,
                    "bias": each.bias,
                    "rms": each.predicted_rms_error,
                }
                for name, each in self.predictions.items()
            },
            "relative_error": self.relative_error,
            "rank": self.rank,
            "condition": self.condition,
            "snr": self.snr,
            "snr_needed": self.snr_needed,
            "peak_speed_m_s": self.peak_speed_m_s,
            "reach_m": self.reach_m,
        }


@dataclass(frozen=True)
class ExcitationDesign:
    """Scores of all waveforms, and the best one that fits the yard (None if none fits)."""

    drive: Drive
    response_s: Mapping[str, float]
    window_s: float
    accuracy: float
    scores: Sequence[WaveformScore]
    best: WaveformScore | None

    @property
    def is_accuracy_reached(self) -> bool:
        """Whether the best waveform reaches the wanted accuracy."""
        return self.best is not None and self.best.relative_error <= self.accuracy

    def to_dict(self) -> dict[str, Any]:
        """The design as plain values."""
        return {
            "motion": self.drive,
            "response_s": dict(self.response_s),
            "window_s": self.window_s,
            "accuracy": self.accuracy,
            "reached": self.is_accuracy_reached,
            "waveforms": [
                {
                    "waveform": score.waveform,
                    "ways": score.ways,
                    "best": score is self.best,
                    **score.to_dict(),
                }
                for score in self.scores
            ],
        }

    def to_scenario(self, base: Scenario) -> Scenario:
        """Scenario whose trial is the best waveform after a short rest.

        Raises:
            DataError: no waveform fits the yard.
        """
        if self.best is None:
            raise DataError("no waveform stays within the yard; give a longer --yard")
        return copy_scenario_with_manoeuvres(base, Rest(duration_s=2.0), self.best.manoeuvre)


def copy_scenario_with_manoeuvres(base_scenario: Scenario, *manoeuvres: Rest | Excite) -> Scenario:
    """Copy of a scenario with these manoeuvres as its trial."""
    campaign = base_scenario.campaign.model_copy(update={"manoeuvres": manoeuvres})
    return base_scenario.model_copy(update={"campaign": campaign})


def compute_settling_time_s(scenario: Scenario, load_kg: float, axis: Axis) -> float:
    """Settling time T of the speed (yaw rate) after a step, to 2 % of its final value.

    The step is half of full throttle, with valve and Coulomb friction; T is about four time
    constants.

    Raises:
        DataError: friction of that axis is zero or holds the machine, so that there is no T.
    """
    body, full = (
        RigidBody.make_loaded_body(scenario, load_kg),
        scenario.full_throttle_force_and_torque,
    )
    if axis == "force":
        inertia, friction, key = body.mass_kg, body.friction_x_N_s_m, "friction_N_s_m"
        step = Excite(
            force=ForceWave(lowest_N=full[0] / 2, highest_N=full[0] / 2),
            duration_s=compute_settling_time_upper_bound_s(inertia, friction, key, scenario),
        )
    else:
        inertia, friction, key = body.inertia_z_kg_m2, body.friction_z_N_m_s, "friction_z_N_m_s"
        step = Excite(
            torque=TorqueWave(lowest_N_m=full[1] / 2, highest_N_m=full[1] / 2),
            duration_s=compute_settling_time_upper_bound_s(inertia, friction, key, scenario),
        )
    motion = solve_motion(copy_scenario_with_manoeuvres(scenario, step), load_kg)
    time_s = np.linspace(0.0, step.duration_s, 20_001)[:-1]
    driven = motion.sample_channels(time_s)
    speed = driven.speed_x_m_s if axis == "force" else driven.yaw_rate_rad_s
    if speed[-1] == 0.0:
        coulomb_key = "coulomb_N" if axis == "force" else "coulomb_z_N_m"
        raise DataError(
            f"half of full throttle does not overcome Coulomb friction ({axis}); raise "
            f"campaign.throttle_force_N, or reduce machine.{coulomb_key}, in the scenario"
        )
    return float(time_s[np.abs(speed / speed[-1] - 1.0) > _SETTLED][-1])


def compute_settling_time_upper_bound_s(
    inertia: float, friction: float, friction_key: str, scenario: Scenario
) -> float:
    """Time in which a step certainly settles, at most an hour."""
    if friction <= 0.0:
        raise DataError(
            f"machine.{friction_key}: is 0, so that a step never settles; give a value above 0"
        )
    return min(12.0 * (inertia / friction + scenario.campaign.valve_lag_s), 3600.0)


def design_excitation(
    scenario: Scenario,
    motion_kind: Drive = "straight",
    accuracy: float = 0.01,
    window_s: float | None = None,
    yard_m: float | None = None,
) -> ExcitationDesign:
    """Score each waveform at full throttle, in one direction and in both.

    Args:
        scenario: scenario with machine, sensors and ground; its first load is used.
        motion_kind: straight (force), spin (torque) or joint (both, full throttle shared).
        accuracy: wanted r.m.s. error over the value: of the mass, the yaw inertia, or both.
        window_s: T_φ, between T and T_f of the slowest axis; default 2 T.
        yard_m: largest distance from the start that the yard allows.

    Raises:
        DataError: a window outside T to T_f, an axis that has no response time, or a force without
            noise.
    """
    load_kg = scenario.campaign.loads_kg[0]
    if scenario.sensors.force_noise_N == 0.0:
        raise DataError(
            "sensors.force_noise_N: is 0, so that there is no signal-to-noise ratio; give a value "
            "above 0"
        )
    response_s = {
        axis: compute_settling_time_s(scenario, load_kg, axis) for axis in _AXES[motion_kind]
    }
    slowest_s = max(response_s.values())
    window_s = 2.0 * slowest_s if window_s is None else window_s
    if not slowest_s <= window_s <= _PERIOD_OVER_RESPONSE * slowest_s:
        raise DataError(
            f"a window of {window_s:g} s cannot be used; give one between the response time "
            f"T = {slowest_s:.2f} s and the period 3 T = {_PERIOD_OVER_RESPONSE * slowest_s:.2f} s"
        )
    scores = [
        score_waveform(scenario, motion_kind, shape, ways, response_s, window_s, accuracy)
        for shape in get_args(Shape)
        for ways in get_args(Ways)
    ]
    return ExcitationDesign(
        motion_kind,
        response_s,
        window_s,
        accuracy,
        scores,
        choose_best_waveform_score(scores, yard_m),
    )


def choose_best_waveform_score(
    scores: Sequence[WaveformScore], yard_m: float | None
) -> WaveformScore | None:
    """Score with the smallest error that fits the yard; None if none fits."""
    fitting = [score for score in scores if yard_m is None or score.reach_m <= yard_m]
    return min(fitting, key=lambda score: score.relative_error, default=None)


def _make_excite_manoeuvre(
    scenario: Scenario,
    motion_kind: Drive,
    wave_shape: Shape,
    directions: Ways,
    response_s: Mapping[str, float],
) -> Excite:
    force_N, torque_N_m = (
        full / 2.0 if motion_kind == "joint" else full
        for full in scenario.full_throttle_force_and_torque
    )
    # rounded to a millisecond, so that the scenario is readable
    periods = {axis: round(_PERIOD_OVER_RESPONSE * each, 3) for axis, each in response_s.items()}
    if motion_kind == "joint":
        ratio = periods["force"] / periods["torque"]
        if max(ratio, 1.0 / ratio) < _LEAST_PERIOD_RATIO:
            periods["torque"] = round(periods["force"] * _OUT_OF_STEP, 3)
    lowest = 0.0 if directions == "one way" else -1.0
    force = torque = None
    if "force" in periods:
        force = ForceWave(
            waveform=wave_shape,
            period_s=periods["force"],
            lowest_N=lowest * force_N,
            highest_N=force_N,
        )
    if "torque" in periods:
        torque = TorqueWave(
            waveform=wave_shape,
            period_s=periods["torque"],
            lowest_N_m=lowest * torque_N_m,
            highest_N_m=torque_N_m,
        )
    return Excite(force=force, torque=torque, duration_s=2.0 * max(periods.values()))


def score_waveform(
    scenario: Scenario,
    motion_kind: Drive,
    wave_shape: Shape,
    directions: Ways,
    response_s: Mapping[str, float],
    window_s: float,
    accuracy: float,
) -> WaveformScore:
    """Drive a waveform, and predict the errors in its worst window."""
    load_kg = scenario.campaign.loads_kg[0]
    manoeuvre = _make_excite_manoeuvre(scenario, motion_kind, wave_shape, directions, response_s)
    period_s = manoeuvre.duration_s / 2.0
    noise, rate_hz = compute_sensor_noise_stds(scenario), scenario.sensors.rate_hz
    filters = Filters(_SMOOTH_SAMPLES, rate_hz)
    samples = round(window_s * rate_hz) + filters.margin_samples_of_filters
    # the motion repeats from the second period on; a window may begin anywhere in it
    last_s = 2.0 * period_s + samples / rate_hz
    longer = manoeuvre.model_copy(update={"duration_s": last_s})
    motion = solve_motion(copy_scenario_with_manoeuvres(scenario, longer), load_kg)
    driven = motion.sample_channels(np.arange(round(last_s * rate_hz)) / rate_hz)
    truth = MeasuredSignals.from_motion(driven)
    asked = _ASKED[motion_kind]

    def find_largest_relative_rms(predictions: Mapping[str, ErrorPrediction]) -> float:
        return max(
            predictions[name].predicted_rms_error / predictions[name].value for name in asked
        )

    windows: list[tuple[int, MeasuredSignals, dict[str, ErrorPrediction]]] = []
    for place in range(_PLACES):
        first = round(period_s * (1.0 + place / _PLACES) * rate_hz)
        part = MeasuredSignals(*(each[first : first + samples] for each in truth))
        windows.append(
            (
                first,
                part,
                predict_estimate_errors_of_drive(motion_kind, filters, part, motion.body, noise),
            )
        )
    first, part, predictions = max(windows, key=lambda window: find_largest_relative_rms(window[2]))
    repeats = slice(round(period_s * rate_hz), round(2.0 * period_s * rate_hz))
    applied = truth.torque_z_N_m if motion_kind == "spin" else truth.force_x_N
    noisy = float(noise.torque_z_N_m if motion_kind == "spin" else noise.force_x_N)
    varies = float(applied[repeats].std())
    allowed = [
        predictions[name].compute_allowed_force_noise_std_newtons(
            accuracy * predictions[name].value
        )
        for name in asked
    ]
    known = [each for each in allowed if each is not None]
    # the noise of the torque scales with that of the force
    least = min(known) / float(noise.force_x_N) * noisy if len(known) == len(allowed) else None
    velocity = driven.speed_x_m_s * np.exp(1j * driven.heading_rad)
    path_m = np.cumsum(velocity[: repeats.stop]) / rate_hz
    return WaveformScore(
        waveform=wave_shape,
        ways=directions,
        manoeuvre=manoeuvre,
        start_s=first / rate_hz,
        predictions=predictions,
        rank=count_parameters_determined_by_motion(
            Channels._make(each[first : first + samples] for each in driven)
        ),
        condition=predict_noise_scaled_condition_number(motion_kind, filters, part, noise),
        snr=varies / noisy,
        snr_needed=None if least is None else varies / least,
        peak_speed_m_s=float(np.abs(driven.speed_x_m_s[repeats]).max()),
        reach_m=float(np.abs(path_m).max()),
        relative_error=find_largest_relative_rms(predictions),
    )


def count_parameters_determined_by_motion(motion: Channels) -> int:
    """Number of the six parameters that a noise-free motion determines."""
    A = planar_rows.make_planar_regressor(
        motion.specific_force_x_m_s2,
        motion.specific_force_y_m_s2,
        motion.speed_x_m_s,
        motion.yaw_rate_rad_s,
        motion.yaw_acc_rad_s2,
    )
    solved = _SOLVED_TO * np.sqrt(np.mean(A**2, axis=(0, 1)))
    return find_identifiable_parameters(
        A, planar_rows.PARAMETERS, np.maximum(solved, np.finfo(float).tiny)
    ).rank
