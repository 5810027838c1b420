"""A simulated log through the whole pipeline in memory, and what its answer is worth."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
import polars as pl

from analysis import Machine
from analysis.model.run_record import Run
from analysis.model.schema import get_column_values
from analysis.simulation import Scenario, SimulatedLog, simulate_campaign
from replay import load_machine
from replay.inputs.derived_logs import MemoryLog, copy_machine_with_simulated_channels
from replay.pipeline import run
from tests.trials.drawn_designs import Sections

#: Settings of an acceleration that is derived from the speed, where there is no accelerometer.
DERIVED = ("settings.forces.acceleration=kinematic", "channels.acc_x_m_s2.derive=d/dt speed_x_m_s")


@dataclass(frozen=True)
class LoadsFound:
    """Load states beside the truth.

    Attributes:
        true: how often the load changed.
        found: how often it was found to.
        right: how many of those are between the right two starts.
        deviations: of each state's mass from that of its starts, over its uncertainty; of a state
            whose starts carry several, the worst.
        payload_deviations: likewise of payloads by difference.
        payload_u_kg: of those.
    """

    true: int
    found: int
    right: int
    deviations: tuple[float, ...] = ()
    payload_deviations: tuple[float, ...] = ()
    payload_u_kg: tuple[float, ...] = ()


@dataclass(frozen=True)
class Weighed:
    """One log's answer beside its truth.

    Attributes:
        row: what was simulated.
        design: the loader's, or one that was drawn.
        seed: of design and noise.
        true_kg: mass.
        mass_kg: of the answer, None where it is withheld.
        u_kg: its standard uncertainty.
        reason: why it is withheld, empty where it is not.
        smallest: of the methods that are shown, over the true mass.
        pooled_std: the paper's deviation of `pooled`.
        terms: of the fit: value over its deviation, the mass' uncertainty by it in kg, and the
            value over the width of its prior.
        starts: simulated.
        loads: where the load changes, what was found of that; mass and truth are then those of the
            start whose load is farthest off.
    """

    row: str
    design: str
    seed: int
    true_kg: float
    mass_kg: float | None
    u_kg: float | None
    reason: str
    smallest: float | None = None
    pooled_std: float | None = None
    terms: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    starts: int = 0
    loads: LoadsFound | None = None

    @property
    def open(self) -> bool:
        """Whether there is an answer."""
        return self.mass_kg is not None and self.u_kg is not None

    @property
    def error_kg(self) -> float:
        """The answer less the truth; NaN where it is withheld."""
        return float("nan") if self.mass_kg is None else self.mass_kg - self.true_kg

    @property
    def deviations(self) -> float:
        """The error over the standard uncertainty."""
        return float("nan") if not self.u_kg else self.error_kg / self.u_kg


@cache
def machine(overrides: tuple[str, ...]) -> Machine:
    """The loader's machine file; without an accelerometer where the acceleration is derived."""
    loaded = load_machine("cat262c.toml", overrides)
    if not any("kinematic" in override for override in overrides):
        return loaded
    channels = {n: c for n, c in loaded.channels.items() if n != "specific_force_x_m_s2"}
    return loaded.model_copy(update={"channels": channels})


def weighed(
    row: str,
    design: str,
    sections: Sections,
    overrides: tuple[str, ...] = ('settings.trace.methods=["pooled"]',),
    acc_gain: float = 1.0,
    body: Mapping[str, float] | None = None,
) -> Weighed:
    """Simulate a log and replay it.

    Args:
        row: its name.
        design: likewise.
        sections: of the scenario.
        overrides: of the machine file.
        acc_gain: what the accelerometer reports of an acceleration.
        body: what else the machine file states of the machine.
    """
    scenario = Scenario.model_validate(sections)
    logs = [with_gain(log, acc_gain) for log in simulate_campaign(scenario)]
    stated = {
        "empty_mass_kg": scenario.machine.mass_kg,
        "force_share": scenario.machine.force_share,
        **(body or {}),
    }
    own = machine(overrides)
    own = own.model_copy(update={"machine": own.machine.model_copy(update=stated)})
    replayed = run(
        [MemoryLog(log) for log in logs], copy_machine_with_simulated_channels(own, logs[0])
    )
    return answer(row, design, scenario, logs, replayed)


def with_gain(log: SimulatedLog, acc_gain: float) -> SimulatedLog:
    """The log of an accelerometer whose gain is not 1."""
    if acc_gain == 1.0:
        return log
    imu = log.topics["imu"].with_columns(pl.col("specific_force_x_m_s2") * acc_gain)
    return SimulatedLog(**{**vars(log), "topics": {**log.topics, "imu": imu}})


def answer(
    row: str, design: str, scenario: Scenario, logs: list[SimulatedLog], replayed: Run
) -> Weighed:
    load = replayed.frames["loads"].row(0, named=True)
    starts = pl.concat([log.manoeuvres.filter(pl.col("kind") == "start") for log in logs])
    true_kg = float(logs[0].trials["mass_kg"][0])
    loads = None
    if starts["mass_kg"].n_unique() > 1 or starts["load_end_kg"].n_unique() > 1:
        loads, load, true_kg = loads_found(starts, replayed, load)
    masses, found = replayed.frames["masses"], replayed.frames["nuisances"]
    shown = get_column_values(masses, "mass_kg")
    shown = shown[np.isfinite(shown)]
    pooled = masses.filter(pl.col("method") == "pooled")
    terms = {
        each["term"]: (
            _number(each["posterior"] / each["posterior_std"]) or 0.0,
            _number(each["u_kg"]) or 0.0,
            _number(each["posterior"] / each["prior_std"]) or 0.0,
        )
        for each in found.iter_rows(named=True)
        if each["posterior"] is not None and each["posterior_std"] is not None
    }
    withheld = load["withheld"] or not _finite(load["mass_kg"]) or not _finite(load["u_kg"])
    return Weighed(
        row,
        design,
        scenario.sensors.seed,
        true_kg,
        None if withheld else load["mass_kg"],
        None if withheld else load["u_kg"],
        load["withheld_for"],
        float(shown.min()) / true_kg if shown.size else None,
        _number(pooled["mass_std_kg"][0]) if pooled.height else None,
        terms,
        starts.height,
        loads,
    )


def loads_found(
    starts: pl.DataFrame, replayed: Run, first: dict[str, Any]
) -> tuple[LoadsFound, dict[str, Any], float]:
    """What was found of the loads, the state that is farthest off, and what it should be."""
    loads, shown = replayed.frames["loads"].to_dicts(), replayed.frames["manoeuvres"]
    t0 = replayed.provenance.t0_unix_ns
    middle = (shown["start_t_ns"] + shown["end_t_ns"]).to_numpy() / 2.0 + t0
    begins, ends = starts["start_ns"].to_numpy(), starts["end_ns"].to_numpy()
    # a load that grows counts with its mean
    gained = (starts["load_end_kg"] - starts["load_kg"]).to_numpy() / 2.0
    truth = starts["mass_kg"].to_numpy() + gained
    at = np.searchsorted(begins, middle, "right") - 1
    inside = (at >= 0) & (middle <= ends[at])
    of, true = shown["load_id"].to_numpy()[inside], truth[at[inside]]
    found, real = np.diff(of) != 0, np.abs(np.diff(true)) > 1.0
    worst, deviations, payloads, payload_u = (0.0, first, float(truth[0])), [], [], []
    base = [row["load_id"] for row in loads if row["empty"]]
    for row in loads:
        mine = true[of == row["load_id"]]
        if row["withheld"] or not mine.size:
            continue
        # a state's mass is that of its starts in their mean; an answer is as good as its worst
        deviations.append(float((row["mass_kg"] - mine.mean()) / row["u_kg"]))
        farthest = float(mine[np.argmax(np.abs(row["mass_kg"] - mine))])
        off = abs(row["mass_kg"] - farthest) / row["u_kg"]
        worst = max(worst, (off, row, farthest), key=lambda each: each[0])
        if base and not row["empty"]:
            carried = mine.mean() - true[np.isin(of, base)].mean()
            payloads.append(float((row["payload_kg"] - carried) / row["payload_u_kg"]))
            payload_u.append(float(row["payload_u_kg"]))
    told = LoadsFound(
        int(real.sum()),
        int(found.sum()),
        int((found & real).sum()),
        tuple(deviations),
        tuple(payloads),
        tuple(payload_u),
    )
    return told, worst[1], worst[2]


def _finite(value: Any) -> bool:
    return value is not None and bool(np.isfinite(value))


def _number(value: Any) -> float | None:
    return float(value) if _finite(value) else None
