"""Simulations that tables and figures share; each is replayed once for all items.

An item of the reproduction needs extracts; an extract is made from one source; a source is
simulated as often as the study requires, one repetition at a time, so that the memory does not grow
with the number of repetitions.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from typing import Any, Final, Generic, NamedTuple, TypeAlias, TypeVar

from analysis.model.machine import Channel, Machine
from analysis.paper.paper_excitation import (
    SteadyDrive,
    integrate_steady_drive,
    make_waveform_scenario,
)
from analysis.paper.paper_limits import LIMITS
from analysis.paper.replayed_campaign import ReplayedCampaign
from analysis.paper.torque_chain import TorqueChain, apply_torque_measuring_chain
from analysis.simulation import Scenario, SimulatedLog
from analysis.simulation.scenario.scenario import SimulatedSensors
from analysis.simulation.scenario.waveforms import ForceWave, TorqueWave

#: Noise of the paper's sensors, which its study assumes to be known: TLS scales by it.
PAPER_NOISE: Final = {
    "noise.force_N": 60.0,
    "noise.acc_m_s2": 0.01,
    "noise.speed_m_s": 0.005,
    "noise.torque_z_N_m": 45.0,
    "noise.yaw_acc_rad_s2": 0.026,
    "noise.yaw_rate_rad_s": 0.001,
}

S = TypeVar("S")
T = TypeVar("T")
#: Function that alters the simulated signals before they are recorded.
Chain: TypeAlias = Callable[[SimulatedLog], SimulatedLog]


@dataclass(frozen=True, eq=False)
class StudySettings:
    """Settings and number of the simulations.

    Attributes:
        scenario: campaign with the seed of the first repetition; each further one has the next.
        machine: body and settings of the replay.
        windows: Monte Carlo windows of each length in Table 1.
        campaigns: number of simulated campaigns.
        replay: function that simulates a campaign and replays it.
    """

    scenario: Scenario
    machine: Machine
    windows: int
    campaigns: int
    replay: Callable[[Scenario, Machine, Chain], ReplayedCampaign]

    def make_scenario_of_repetition(self, repetition: int) -> Scenario:
        """Scenario with the seed of a repetition, which is counted from 0."""
        return self.scenario.copy_with_seed(self.scenario.sensors.seed + repetition)


@dataclass(frozen=True, eq=False)
class SimulationSource(Generic[S]):
    """Simulation: its name, its number of repetitions, and the function that makes one."""

    name: str
    make: Callable[[StudySettings, int], S]
    repeats: Callable[[StudySettings], int] = lambda _: 1


@dataclass(frozen=True, eq=False)
class Extract(Generic[S, T]):
    """Data kept from each repetition of a source."""

    source: SimulationSource[S]
    make: Callable[[S], T]


class RepetitionResults:
    """Results of the extracts so far, one per repetition of their sources."""

    def __init__(self) -> None:
        self._made: dict[Extract[Any, Any], list[Any]] = {}

    def add_result_of_repetition(self, extract: Extract[Any, T], result: T) -> None:
        """Append the result of one more repetition to the results of an extract."""
        self._made.setdefault(extract, []).append(result)

    def list_results_of_extract(self, extract: Extract[Any, T]) -> list[T]:
        """Results of an extract from all repetitions."""
        return self._made[extract]

    def get_only_result(self, extract: Extract[Any, T]) -> T:
        """Result of an extract whose source has a single repetition."""
        (made,) = self._made[extract]
        return made


class Repetition(NamedTuple):
    """One repetition of one source: simulated, replayed, reduced."""

    name: str
    take: Callable[[], None]


def copy_machine_with_paper_noise(machine: Machine) -> Machine:
    """Machine with the paper's noise instead of the log's."""
    return machine.model_copy(update={"settings": machine.settings.copy_with_changes(PAPER_NOISE)})


def plan_repetitions(
    needed_extracts: Iterable[Extract[Any, Any]], study: StudySettings, results: RepetitionResults
) -> list[Repetition]:
    """Plan every repetition of every needed source.

    Args:
        needed_extracts: extracts to make; duplicates are made once.
        study: settings and number of simulations.
        results: receives the results of the extracts.
    """
    wanted: dict[SimulationSource[Any], list[Extract[Any, Any]]] = {}
    for extract in dict.fromkeys(needed_extracts):
        wanted.setdefault(extract.source, []).append(extract)
    planned: list[Repetition] = []
    for source, of_it in wanted.items():
        repeats = source.repeats(study)
        for number in range(repeats):
            name = source.name if repeats == 1 else f"{source.name} {number + 1}"
            planned.append(
                Repetition(name, partial(_add_repetition, source, number, of_it, study, results))
            )
    return planned


def _add_repetition(
    source: SimulationSource[Any],
    repetition: int,
    wanted_extracts: Iterable[Extract[Any, Any]],
    study: StudySettings,
    results: RepetitionResults,
) -> None:
    made = source.make(study, repetition)
    for extract in wanted_extracts:
        results.add_result_of_repetition(extract, extract.make(made))


class SteadyStudy(NamedTuple):
    """Steady oscillation, its sensors, and the number of windows to measure."""

    drive: SteadyDrive
    sensors: SimulatedSensors
    windows: int


def _return_log_as_extract(log: SimulatedLog) -> SimulatedLog:
    return log


def _make_steady_study(study: StudySettings, _repetition: int) -> SteadyStudy:
    return SteadyStudy(
        integrate_steady_drive(study.scenario), study.scenario.sensors, study.windows
    )


def _replay_seeded_campaign(study: StudySettings, repetition: int) -> ReplayedCampaign:
    settings = study.machine.settings.copy_with_changes(
        {
            "gate.window_samples": LIMITS.fixed_window_samples,
            "gate.threshold_nat": LIMITS.fixed_threshold_nat,
        }
    )
    machine = study.machine.model_copy(update={"settings": settings})
    return study.replay(
        study.make_scenario_of_repetition(repetition), machine, _return_log_as_extract
    )


def _replay_torque_chain_campaign(study: StudySettings, repetition: int) -> ReplayedCampaign:
    # (17) as printed has no force share
    printed = study.machine.machine.model_copy(update={"force_share": 1.0})
    machine = study.machine.model_copy(update={"machine": printed})
    return study.replay(
        study.make_scenario_of_repetition(repetition),
        machine,
        lambda log: apply_torque_measuring_chain(log, TorqueChain()),
    )


def _replay_straight_drive(study: StudySettings, _repetition: int) -> ReplayedCampaign:
    driven = make_waveform_scenario(study.scenario, force=ForceWave(), torque=None)
    return study.replay(driven, study.machine, _return_log_as_extract)


def _replay_spin(study: StudySettings, _repetition: int) -> ReplayedCampaign:
    driven = make_waveform_scenario(study.scenario, force=None, torque=TorqueWave())
    yaw = {"yaw_acc_rad_s2": Channel(derive="d/dt yaw_rate_rad_s")}
    machine = study.machine.model_copy(update={"channels": {**study.machine.channels, **yaw}})
    return study.replay(driven, machine, _return_log_as_extract)


def _replay_start(study: StudySettings, _repetition: int) -> ReplayedCampaign:
    return study.replay(
        make_scenario_of_one_start(study.scenario), study.machine, _return_log_as_extract
    )


def _replay_cruise(study: StudySettings, repetition: int) -> ReplayedCampaign:
    short = make_scenario_of_one_start(study.make_scenario_of_repetition(repetition))
    campaign = short.campaign.model_copy(update={"cruise_s": LIMITS.cruise_s})
    return study.replay(
        short.model_copy(update={"campaign": campaign}), study.machine, _return_log_as_extract
    )


def make_scenario_of_one_start(scenario: Scenario) -> Scenario:
    """Scenario with one start and stop without load."""
    campaign = scenario.campaign.model_copy(update={"loads_kg": (0.0,), "runs": 1})
    return scenario.model_copy(update={"campaign": campaign})


def _count_campaigns(study: StudySettings) -> int:
    return study.campaigns


def _count_cruises(study: StudySettings) -> int:
    return max(study.windows // LIMITS.windows_per_cruise, 2)


#: The steady oscillation under the paper's triangle, for windows without a gate.
OSCILLATION: Final = SimulationSource("windows", _make_steady_study)
#: Campaigns of section 4.3, with an ideal torque chain and with one that would explain Table 2.
CAMPAIGNS: Final = SimulationSource("campaign", _replay_seeded_campaign, _count_campaigns)
CHAINED_CAMPAIGNS: Final = SimulationSource(
    "torque chain", _replay_torque_chain_campaign, _count_campaigns
)
#: The excitations of Figures 2 to 4.
LINEAR: Final = SimulationSource("linear motion", _replay_straight_drive)
ROTATION: Final = SimulationSource("rotation", _replay_spin)
#: One start and stop.
START: Final = SimulationSource("start and stop", _replay_start)
#: A start, and a long cruise.
CRUISES: Final = SimulationSource("cruise", _replay_cruise, _count_cruises)
