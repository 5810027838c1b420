"""Load states at manoeuvre level: changes found by their size, false changes, intervals that hold.

    python -P benchmarks/load_states.py [--logs 100] [--seed 77] [--write]
    python -P benchmarks/load_states.py --whole 60 [--write]

Draws what manoeuvres say of their masses instead of logs: 15 kg of noise each, stated with 10 % of
error, scatter of 0, 1 and 3 times that, and offsets that alternating directions show. `--whole`
simulates and replays logs of one load instead, so many of each kind, and counts states.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import typer
from scipy.stats import norm

from analysis.simulation import Scenario, simulate_campaign
from analysis.weighing.load_states import (
    LoadStates,
    find_load_states,
)
from benchmarks.honesty_rows import LOADER, POOLED
from benchmarks.page import markdown, put
from benchmarks.weighed import machine
from estimators.joint.unit_levels import UnitLevels
from estimators.numerics.autocorrelation import compute_student_to_normal_ratio
from replay.inputs.derived_logs import MemoryLog, copy_machine_with_simulated_channels
from replay.pipeline import run
from tests.trials.drawn_designs import join_designs

NOISE_KG: Final = 15.0
MASS_KG: Final = 3700.0
#: What the machine carries, so that a load is a load.
MOST_KG: Final = 1200.0
SCATTERS: Final = (0.0, 1.0, 3.0)
#: Jumps in deviations of one manoeuvre, noise and scatter together.
JUMPS: Final = (2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 9.0, 12.0)
#: A boom moves at every change of load, and at so many other places.
BOOM_MOVES: Final = 0.2
#: States of a manoeuvre each: whether the machine file knows their scatter, whether a boom is seen
#: to move, and whether an offset of the force may alternate with the direction.
SINGLES: Final = {
    "scatter known": (True, False, True),
    "a boom moves": (False, True, True),
    "scatter known, no offset": (True, False, False),
}
_BOTH_WAYS: Final = {"directions": "alternating"}
#: Throttles from 0.7 to 1.3 times the loader's.
_THROTTLES: Final = {
    "campaign": {"throttle_force_N": 7800.0},
    "starts": {"throttle_least": 0.7 / 1.3, "throttle_most": 1.0},
}
#: Logs of one load: what else is in each.
ONE_LOAD: Final[dict[str, Mapping[str, Mapping[str, Any]]]] = {
    "nothing else": {},
    "throttle varied by ± 30 %": _THROTTLES,
    "throttle varied by ± 30 %, both ways, slip 80 kN": {
        **_THROTTLES,
        "starts": {**_THROTTLES["starts"], **_BOTH_WAYS},
        "machine": {"slip_stiffness_N": 80_000.0},
    },
    "300 N of offset, both ways": {"starts": _BOTH_WAYS, "sensors": {"force_bias_N": 300.0}},
    "0.03 m/s² of bias, both ways": {"starts": _BOTH_WAYS, "sensors": {"acc_bias_m_s2": 0.03}},
    "gain drifts by 1 %": {"defects": {"force_gain_drift": 0.01}},
    "friction of 200 ± 30 N by start": {
        "machine": {"coulomb_N": 200.0},
        "starts": {"coulomb_std_N": 30.0},
    },
}


@dataclass(frozen=True)
class Drawn:
    """Manoeuvres, their true states, and the levels of those."""

    units: UnitLevels
    state: np.ndarray
    level_kg: np.ndarray


def manoeuvres(
    dice: np.random.Generator,
    state: np.ndarray,
    level_kg: np.ndarray,
    scatter: float,
    *,
    offset_N: float = 0.0,
    drift_share: float = 0.0,
) -> Drawn:
    """What manoeuvres of some states say.

    Args:
        dice: of this log.
        state: of each manoeuvre.
        level_kg: of each state.
        scatter: between manoeuvres, over their noise.
        offset_N: a constant force, seen with alternating sign at 1.5 m/s².
        drift_share: of the mass over the log.
    """
    count = state.size
    own_kg = NOISE_KG * dice.uniform(0.7, 1.4, count)
    direction = np.where(np.arange(count) % 2 == 0, 1.0, -1.0)
    y = level_kg[state] + dice.normal(0.0, own_kg) + dice.normal(0.0, NOISE_KG * scatter, count)
    y = y + offset_N / 1.5 * direction + MASS_KG * drift_share * np.linspace(-0.5, 0.5, count)
    # the deviation that a manoeuvre states is itself estimated
    stated = own_kg * dice.normal(1.0, 0.1, count).clip(0.6, 1.4)
    x = (direction / 1.5)[:, None]
    prior_N = np.array([[200.0**-2]])
    units = UnitLevels(y, x, stated**2, prior_N, np.zeros(1), np.ones(count - 1, np.int64))
    return Drawn(units, state, level_kg)


def changing(
    dice: np.random.Generator, jump: float, scatter: float, fewest: int
) -> tuple[np.ndarray, np.ndarray]:
    """States of at least so many manoeuvres each: 1 to 20 changes among up to 60."""
    most = max(2, 60 // fewest)
    states = int(dice.integers(2, min(most, 21) + 1))
    sizes = fewest + dice.multinomial(
        int(dice.integers(0, max(60 - fewest * states, 0) + 1)), np.full(states, 1.0 / states)
    )
    step_kg = jump * NOISE_KG * np.hypot(1.0, scatter)
    load_kg = [0.0]
    for up in dice.choice([-1.0, 1.0], states - 1):
        next_kg = load_kg[-1] + up * step_kg
        load_kg.append(next_kg if 0.0 <= next_kg <= MOST_KG else load_kg[-1] - up * step_kg)
    return np.repeat(np.arange(states), sizes), MASS_KG + np.array(load_kg)


def changes(found: LoadStates, drawn: Drawn) -> np.ndarray:
    """Right, found and true changes."""
    mine, true = np.diff(found.state_of_manoeuvre) != 0, np.diff(drawn.state) != 0
    return np.array([(mine & true).sum(), mine.sum(), true.sum()])


def f1(counts: np.ndarray) -> float:
    right, found, true = counts
    return 2.0 * right / max(found + true, 1)


def curve(dice: np.random.Generator, logs: int) -> Iterator[list[str]]:
    """F1 by jump, beside what a test that knows place, states and variances finds."""
    for jump in JUMPS:
        cells = [f"{jump:g} σ"]
        for scatter in SCATTERS:
            counts = np.zeros(3)
            for _ in range(logs):
                drawn = manoeuvres(dice, *changing(dice, jump, scatter, 3), scatter)
                counts += changes(
                    find_load_states(drawn.units, np.arange(drawn.state.size), None), drawn
                )
            cells.append(f"{f1(counts):.3f}")
        cells += [f"{singles(dice, jump, logs, *about):.3f}" for about in SINGLES.values()]
        # three against three, at 1 % over some thirty places
        power = norm.cdf(jump / np.sqrt(2.0 / 3.0) - norm.isf(0.005 / 30.0))
        yield [*cells, f"{2.0 * power / (1.0 + power):.3f}"]


def singles(
    dice: np.random.Generator, jump: float, logs: int, known: bool, boom: bool, offset: bool
) -> float:
    """F1 of states of which many have one manoeuvre, which do not scatter."""
    counts = np.zeros(3)
    for _ in range(logs):
        drawn = manoeuvres(dice, *changing(dice, jump, 0.0, 1), 0.0)
        units = drawn.units
        if boom:
            moves = (np.diff(drawn.state) > 0) | (dice.random(units.kind.size) < BOOM_MOVES)
            units = replace(units, kind=1 + moves.astype(np.int64))
        if not offset:
            units = replace(units, x=np.zeros_like(units.x))
        found = find_load_states(units, np.arange(drawn.state.size), 0.0 if known else None)
        counts += changes(found, drawn)
    return f1(counts)


def one_state(dice: np.random.Generator, logs: int) -> Iterator[list[str]]:
    """How often a log without a change is one state, or says that it cannot tell."""
    kinds = {
        "nothing else": {},
        "300 N of offset, alternating": {"offset_N": 300.0},
        "drift of 1 %": {"drift_share": 0.01},
        "0.03 m/s² of bias, alternating": {"offset_N": 0.03 * MASS_KG},
        "a boom that moves at every stand": {},
    }
    for name, more in kinds.items():
        boom = name.startswith("a boom")
        for scatter in SCATTERS:
            if scatter and more:
                continue
            single = doubted = 0
            for _ in range(logs):
                count = int(dice.integers(3, 61))
                state, level_kg = np.zeros(count, np.int64), np.array([MASS_KG])
                units = manoeuvres(dice, state, level_kg, scatter, **more).units
                units = replace(units, kind=units.kind + boom)
                found = find_load_states(units, np.arange(count), None)
                single += found.state_count == 1
                doubted += found.alternative_partition is not None
            label = f"{name}, scatter {scatter:g}"
            yield [label, f"{100 * single / logs:.1f} %", f"{100 * doubted / logs:.1f} %"]


def whole_states(name: str, number: int) -> tuple[int, bool]:
    """How many states a log of one load has, and whether it says that it cannot tell."""
    starts = int(np.random.default_rng([number, 11]).integers(3, 13))
    own = {"campaign": {"runs": starts}, "sensors": {"seed": 8_000_000 + number}}
    scenario = Scenario.model_validate(join_designs(join_designs(LOADER, own), ONE_LOAD[name]))
    (log,) = simulate_campaign(scenario)
    replayed = run(MemoryLog(log), copy_machine_with_simulated_channels(machine((POOLED,)), log))
    loads = replayed.frames["loads"]
    return loads.height, "states or scatter" in (loads["said"][0] or "")


def whole_logs(logs: int) -> Iterator[list[str]]:
    """A row a kind of log of one load."""
    for name in ONE_LOAD:
        found = [whole_states(name, number) for number in range(logs)]
        single = sum(count == 1 for count, _ in found)
        doubted = sum(doubt for _, doubt in found)
        row = [name, str(logs), f"{100 * single / logs:.1f} %", f"{100 * doubted / logs:.1f} %"]
        print(", ".join(row), flush=True)
        yield row


def held(dice: np.random.Generator, logs: int) -> Iterator[list[str]]:
    """Intervals of the states' masses and of differences, where the states are right."""
    for scatter in SCATTERS:
        masses: list[float] = []
        payloads: list[float] = []
        for _ in range(logs):
            state, level_kg = changing(dice, 15.0, scatter, 3)
            if state.size - level_kg.size < 4:
                continue
            drawn = manoeuvres(dice, state, level_kg, scatter)
            found = find_load_states(drawn.units, np.arange(state.size), None)
            if not np.array_equal(found.state_of_manoeuvre, state):
                continue
            weight = 1.0 / (drawn.units.variance + found.scatter_kg**2)
            total = np.bincount(state, weights=weight)
            mean = np.bincount(state, weights=weight * found.manoeuvre_mass_kg) / total
            noise = np.bincount(state, weights=weight**2 * drawn.units.variance) / total**2
            between = np.bincount(state, weights=(weight * found.scatter_kg) ** 2) / total**2
            variance = (
                noise + between * compute_student_to_normal_ratio(found.degrees_of_freedom) ** 2
            )
            errors = mean - level_kg
            masses += (errors / np.sqrt(variance)).tolist()
            payloads += ((errors[1:] - errors[0]) / np.sqrt(variance[1:] + variance[0])).tolist()
        for_masses, for_payloads = np.array(masses), np.array(payloads)
        yield [
            f"{scatter:g}",
            str(for_masses.size),
            f"{100 * (np.abs(for_masses) < 1.96).mean():.1f} %",
            f"{100 * (np.abs(for_payloads) < 1.96).mean():.1f} %",
            f"{np.sqrt((for_payloads**2).mean()):.2f}",
        ]


def main(logs: int = 100, seed: int = 77, whole: int = 0, write: bool = False) -> None:
    if whole:
        table = markdown(["one load", "logs", "one state", "cannot tell"], list(whole_logs(whole)))
        print(table)
        if write:
            put("loads.md", "whole logs of one load", table)
        return
    dice = np.random.default_rng(seed)
    head = ["jump", *(f"found, scatter {scatter:g}" for scatter in SCATTERS)]
    tables = [
        markdown(
            [*head, *(f"single starts, {name}" for name in SINGLES), "theory"],
            list(curve(dice, logs)),
        ),
        markdown(["no change", "one state", "cannot tell"], list(one_state(dice, 4 * logs))),
        markdown(
            ["scatter", "states", "mass held", "payload held", "r.m.s. payload error / u"],
            list(held(dice, 40 * logs)),
        ),
    ]
    text = "\n\n".join(tables)
    print(text)
    if write:
        put("loads.md", "load states", text)


if __name__ == "__main__":
    typer.run(main)
