"""Reproduce the paper's tables, figures and claims from replays of simulated campaigns."""

from collections.abc import Callable, Sequence
from typing import Any

import polars as pl

from analysis.model.machine import Machine
from analysis.paper.replayed_campaign import ReplayedCampaign
from analysis.paper.simulated_sources import (
    Repetition,
    RepetitionResults,
    StudySettings,
    copy_machine_with_paper_noise,
    plan_repetitions,
)
from analysis.simulation import Scenario, SimulatedLog, simulate_campaign
from recordings.paper.paper_items import Item, ItemResult, compute_paper_item
from replay.inputs.derived_logs import MemoryLog, copy_machine_with_simulated_channels
from replay.machines.machine_file import load_machine
from replay.pipeline import run


class Reproduction:
    """Plan to reproduce some items: run `repetitions`, then `compute_paper_items`.

    Args:
        items: names from `recordings.paper.paper_items.ITEMS`.
        windows: Monte Carlo windows of each length in Table 1; a fifth as many long cruises.
        campaigns: simulated campaigns for Tables 2 to 4, Figures 6 to 8 and the claims.
        seed: seed of the first campaign; each further one has the next.
    """

    def __init__(
        self, items: Sequence[Item[Any]], *, windows: int, campaigns: int, seed: int
    ) -> None:
        self._items = tuple(items)
        self._digests = RepetitionResults()
        study = StudySettings(
            scenario=Scenario().copy_with_seed(seed),
            machine=copy_machine_with_paper_noise(load_machine("cat262c.toml")),
            windows=windows,
            campaigns=campaigns,
            replay=replay_simulated_campaign_in_memory,
        )
        needs = [extract for item in self._items for extract in item.needs]
        #: one simulation each, which are counted as progress
        self.repetitions: tuple[Repetition, ...] = tuple(
            plan_repetitions(needs, study, self._digests)
        )

    def compute_paper_items(self, on_stage: Callable[[str], None]) -> list[ItemResult]:
        """Run all repetitions, then make the items.

        Args:
            on_stage: called with the name of each repetition as it begins.

        Returns:
            Items in the requested order.
        """
        for repetition in self.repetitions:
            on_stage(repetition.name)
            repetition.take()
        return [compute_paper_item(item, self._digests) for item in self._items]


def replay_simulated_campaign_in_memory(
    scenario: Scenario,
    machine: Machine,
    transform_log: Callable[[SimulatedLog], SimulatedLog] = lambda log: log,
) -> ReplayedCampaign:
    """Simulate a campaign and replay it from memory.

    Args:
        scenario: scenario to simulate.
        machine: settings and body; its channels are read from the simulation's topics.
        transform_log: applied to the signals before they are recorded.
    """
    logs = [transform_log(log) for log in simulate_campaign(scenario)]
    replayed = run(
        [MemoryLog(log) for log in logs], copy_machine_with_simulated_channels(machine, logs[0])
    )
    return ReplayedCampaign(
        scenario,
        replayed,
        pl.concat([log.trials for log in logs]),
        pl.concat([log.noise_free_motion for log in logs]),
    )
