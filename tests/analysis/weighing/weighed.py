"""Simulated logs, weighed: nine starts without load unless the scenario says otherwise."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import polars as pl

from analysis.model.machine import Machine
from analysis.model.run_record import Run
from analysis.model.verdict import Check, Verdict
from analysis.simulation import Scenario, simulate_campaign
from analysis.weighing.weigh import Weighing, weigh
from replay import load_machine
from replay.inputs.derived_logs import MemoryLog, copy_machine_with_simulated_channels
from replay.pipeline import run
from tests.made_once import make_value_once

TRUE_KG = 3614.0
FRICTION_N_S_M = 2891.0
RUNS = {"campaign": {"loads_kg": [0.0], "runs": 9}}
#: Both ways and at different throttles: what tells the terms apart.
RICH = {"starts": {"directions": "alternating", "throttle_least": 0.5}}


@dataclass(frozen=True)
class Weighed:
    """A replay, and what its log was made with."""

    replayed: Run
    true_kg: float
    machine: Machine

    @property
    def load(self) -> dict[str, Any]:
        """The row of `loads`."""
        return self.replayed.frames["loads"].row(0, named=True)

    @property
    def error_u(self) -> float:
        """The error of the mass, in standard uncertainties."""
        return (self.load["mass_kg"] - self.true_kg) / self.load["u_kg"]

    @cached_property
    def terms(self) -> dict[str, dict[str, Any]]:
        """The rows of `nuisances`."""
        return {row["term"]: row for row in self.replayed.frames["nuisances"].to_dicts()}

    def off(self, term: str, expected: float) -> float:
        """How many of its deviations a term is from a value."""
        return (self.terms[term]["posterior"] - expected) / self.terms[term]["posterior_std"]

    @cached_property
    def causes(self) -> dict[str, float | None]:
        """The budget, in kg."""
        rows = self.replayed.frames["budget"].to_dicts()
        return {row["cause"]: row["u_kg"] for row in rows}

    @cached_property
    def weighing(self) -> Weighing:
        """The fit itself."""
        stages = (self.replayed.frames[name] for name in ("aligned", "excitation", "gate", "noise"))
        found = weigh(*stages, self.machine)
        assert found is not None
        return found

    @cached_property
    def verdict(self) -> Verdict:
        """The checks."""
        return Verdict.from_frame(self.replayed.frames["verdict"])

    def check(self, name: str) -> Check:
        """One of them."""
        return next(check for check in self.verdict.checks if check.check == name)

    @property
    def fired(self) -> set[str]:
        """The checks that failed."""
        return {check.check for check in self.verdict.checks if check.passed is False}


def merged(*scenarios: dict[str, Any]) -> dict[str, Any]:
    """Sections of scenarios, later ones over earlier ones."""
    out: dict[str, Any] = {}
    for each in scenarios:
        for section, keys in each.items():
            out[section] = {**out.get(section, {}), **keys}
    return out


def weighed(
    scenario: dict[str, Any],
    *overrides: str,
    body: dict[str, Any] | None = None,
    changed: Callable[[Mapping[str, pl.DataFrame]], dict[str, pl.DataFrame]] | None = None,
) -> Weighed:
    """Simulate and replay; what is as it was simulated, once a session.

    Args:
        scenario: sections, over nine starts without load; a log a load, in one time line.
        overrides: of the machine file.
        body: what is known of the machine.
        changed: makes other topics of those simulated.
    """
    if changed is None:
        made_of = f"weighed {json.dumps([scenario, overrides, body], sort_keys=True)}"
        return make_value_once(made_of, lambda: simulate_and_weigh(scenario, overrides, body, None))
    return simulate_and_weigh(scenario, overrides, body, changed)


def simulate_and_weigh(
    scenario: dict[str, Any],
    overrides: Sequence[str] = (),
    body: dict[str, Any] | None = None,
    changed: Callable[[Mapping[str, pl.DataFrame]], dict[str, pl.DataFrame]] | None = None,
) -> Weighed:
    """The same, whatever was made before."""
    logs = list(simulate_campaign(Scenario.model_validate(merged(RUNS, scenario))))
    body_of = logs[0].scenario.machine
    machine = load_machine("cat262c.toml", ['settings.trace.methods=["pooled", "ls"]', *overrides])
    known = {
        "empty_mass_kg": body_of.mass_kg,
        "force_share": body_of.force_share,
        **(body or {}),
    }
    about = machine.machine.model_copy(update=known)
    machine = machine.model_copy(update={"machine": about})
    true_kg = float(logs[0].trials["mass_kg"][0])
    if changed is not None:
        logs = [replace(log, topics=changed(log.topics)) for log in logs]
    machine = copy_machine_with_simulated_channels(machine, logs[0])
    return Weighed(run([MemoryLog(log) for log in logs], machine), true_kg, machine)
