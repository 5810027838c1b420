"""Drive the trials of a log one after the other: what the operator asks for, integrated."""

from dataclasses import replace

import numpy as np

from analysis.simulation import plant
from analysis.simulation.body import RigidBody
from analysis.simulation.integrated import FREE, IntegratedLog
from analysis.simulation.machine_driver import STEP_S, WAVE_STEP_S, MachineDriver, StartOrder
from analysis.simulation.manoeuvres import Excite, Manoeuvre, Rest, Start
from analysis.simulation.motion import ManoeuvreTimes
from analysis.simulation.plant import DriveStage
from analysis.simulation.scenario import Scenario
from analysis.simulation.timeline import DrivenManoeuvre
from estimators.errors import ScenarioError


def integrate_log(scenario: Scenario, load_kg: float, load_index: int) -> IntegratedLog:
    """Drive all trials of one log, without noise.

    Args:
        scenario: the machine, the ground and the manoeuvres of a trial; straight ones.
        load_kg: in the bucket when the log begins.
        load_index: index of the log in the campaign, which starts that differ are drawn from.

    Raises:
        ScenarioError: a machine does not start, does not stop, or goes too fast.
    """
    driver = _TrialDriver(scenario, load_kg, load_index)
    asked_s = sum(_asked_s(each) for each in scenario.campaign.trial)
    driver.expect(scenario.campaign.runs * asked_s)
    trial_s = [0.0]
    for trial in range(scenario.campaign.runs):
        for number, manoeuvre in enumerate(scenario.campaign.trial):
            driver.drive(trial, number, manoeuvre, trial_s[-1])
        trial_s.append(driver.time_s)
    driver.rest(scenario.campaign.rest_s + STEP_S, driver.mass_kg)
    return IntegratedLog(
        scenario,
        np.array(trial_s),
        tuple(driver.driven),
        driver.kept.rows,
        driver.kept.stages,
    )


def _asked_s(manoeuvre: Manoeuvre) -> float:
    """About how long a manoeuvre takes, its stop included."""
    match manoeuvre:
        case Rest():
            return 0.0  # a rest has two rows
        case Start():
            return manoeuvre.start_s + manoeuvre.cruise_s + manoeuvre.coast_s + 2.0
        case _:
            return manoeuvre.duration_s + 2.0 if isinstance(manoeuvre, Excite) else 0.0


class _TrialDriver(MachineDriver):
    """Drives the manoeuvres of a trial."""

    def __init__(self, scenario: Scenario, load_kg: float, load_index: int) -> None:
        super().__init__(scenario, load_kg, load_index)
        self.driven: list[DrivenManoeuvre] = []
        self._load_kg = load_kg
        self.mass_kg = RigidBody.loaded(scenario, load_kg).mass_kg
        #: Whether a stand has the load of the start after it, or, as logs of before have it, the
        #: one that the log began with.
        self._stands_loaded = bool(scenario.chassis.pitch_deg_kg or scenario.loading.spill_1_s)
        self._added_kg, self._lost_kg = 0.0, 0.0

    def drive(self, trial: int, number: int, manoeuvre: Manoeuvre, trial_begin_s: float) -> None:
        """One manoeuvre, from standing to standing."""
        loading = self.scenario.loading
        added_kg = loading.added_kg(self.starts)
        if added_kg != self._added_kg:
            self._added_kg, self._lost_kg = added_kg, 0.0
        load_kg = self._load_kg + added_kg - self._lost_kg
        body = RigidBody.loaded(self.scenario, load_kg)
        body = replace(body, rolling_x_N=self.rolling_resistance(body.mass_kg))
        if self._stands_loaded:
            self.mass_kg = body.mass_kg
        load_end_kg, direction, throttle = load_kg, None, None
        match manoeuvre:
            case Rest():
                times = self.rest(manoeuvre.duration_s, self.mass_kg)
            case Start():
                body = replace(body, coulomb_x_N=self.drawn_coulomb())
                sign = self._sign(manoeuvre)
                direction = "forward" if sign > 0.0 else "reverse"
                throttle = manoeuvre.throttle * self.throttle()
                order = StartOrder(
                    sign,
                    throttle,
                    manoeuvre.start_s,
                    manoeuvre.cruise_s,
                    manoeuvre.coast_s,
                    manoeuvre.digging_N,
                    manoeuvre.digging_s,
                    loading.fill_kg_s,
                    load_kg,
                    loading.spill_1_s,
                )
                times, filled_kg, spilled_kg = self.start(order, body)
                load_end_kg += filled_kg - spilled_kg
                self._lost_kg += spilled_kg
                if self._stands_loaded:
                    self.mass_kg = body.mass_kg - spilled_kg
            case Excite():
                times = self._excite(manoeuvre, body)
            case _:
                raise ScenarioError(
                    f"campaign.manoeuvres.{number}: a {manoeuvre.kind} cannot be integrated"
                )
        since = times.since(trial_begin_s)
        body = self.warmed(body, times.start_s)
        self.driven.append(
            DrivenManoeuvre(trial, number, since, body, load_kg, load_end_kg, direction, throttle)
        )

    def _excite(self, excite: Excite, body: RigidBody) -> ManoeuvreTimes:
        """A waveform of the drive force, then brakes."""
        begin_s, force = self.time_s, excite.force
        assert force is not None
        since_s = np.arange(0.0, excite.duration_s + 2.0 * WAVE_STEP_S, WAVE_STEP_S)
        wave = np.array([self.scenario.driven(float(value), 0.0)[0] for value in force(since_s)])
        stage = DriveStage(begin_s, body.mass_kg, coulomb_N=body.coulomb_x_N)
        self.state[plant.BRAKE] = -body.mass_kg * self.uphill_m_s2()
        self.advance(FREE, stage, excite.duration_s, wave)
        braking_s = self.time_s
        self.brake(stage._replace(begin_s=braking_s))
        return ManoeuvreTimes("excite", begin_s, begin_s, None, braking_s, self.time_s)

    def _sign(self, start: Start) -> float:
        sign = 1.0 if start.direction == "forward" else -1.0
        turned = self.scenario.starts.directions == "alternating" and self.starts % 2 == 1
        return -sign if turned else sign
