"""Shifts that are drawn as logs (machine, ground, loads, operator, recorder), and what is found.

What is drawn, and from what, is in `RANGES` and `drawn_shift`.
"""

import json
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import polars as pl

from analysis.model.machine import Machine
from analysis.model.prior_settings import PriorSettings
from analysis.model.run_record import Run
from analysis.simulation import Scenario
from analysis.simulation.trials.trial_limits import refuse_undrivable_shift
from estimators.errors import ScenarioError
from replay import load_machine, open_log
from replay.pipeline import run
from replay.simulation.simulate_logs import make_shift_truth_path, simulate_scenario_to_logs
from tests.trials.drawn_designs import (
    LOADER_KG,
    Sections,
    join_designs,
    with_field_physics,
)

YARD: Final = Path(__file__).resolve().parent.parent / "examples" / "yard.toml"
#: A dump is found when it is so near to a true one.
MATCHED_S: Final = 5.0
#: Standard uncertainties of the scale that the machine file states, as shares.
GAIN_U: Final = 0.01
RADIUS_U: Final = 0.005
LOADS_KG: Final = (200.0, 1100.0)
_NS: Final = 1e9
_TRIES: Final = 50

#: Uniform between these, a key of a scenario each.
RANGES: Final[dict[str, dict[str, tuple[float, float]]]] = {
    "terrain": {
        "slope_deg": (-2.0, 3.0),
        "hills_deg": (0.0, 1.5),
        "hills_length_m": (15.0, 60.0),
        "hills_phase_deg": (0.0, 360.0),
    },
    "starts": {
        "throttle_least": (0.5, 0.9),
        "stick_share": (0.0, 0.1),
        "stick_hz": (0.3, 1.5),
        "coulomb_std_N": (0.0, 50.0),
    },
    "shift": {
        "load_kg": (400.0, 900.0),
        "load_std_kg": (60.0, 180.0),
        "carry_back_kg": (0.0, 30.0),
        "haul_m": (25.0, 70.0),
        "reverse_share": (0.0, 0.5),
        "pause_s": (1.5, 4.0),
        "dig_s": (3.0, 6.0),
        "dump_s": (4.0, 8.0),
        "idle_share": (0.0, 0.1),
        "restart_s": (1.0, 20.0),
        "damage_share": (0.005, 0.05),
    },
    "log": {"dropout_share": (0.0, 0.005)},
    "sensors": {"force_drift_N": (0.0, 60.0), "force_noise_N": (30.0, 120.0)},
}
#: Any of these, both ends included.
COUNTS: Final = {
    "logs": (3, 6),
    "damaged_logs": (0, 2),
    "haul_starts_most": (2, 4),
    "empty_starts_most": (1, 3),
}


@dataclass(frozen=True)
class ShiftFound:
    """A shift beside its truth.

    Attributes:
        seed: of all that is drawn.
        mean_load_kg: as drawn for the shift.
        true: cycles.
        hidden: of those, whose dump no log has.
        found: dumps.
        right: of those, within `MATCHED_S` of a true one.
        true_t: dumped.
        true_counted_t: dumped in the true cycles that are matched.
        found_t: sum of the review.
        u_t: its standard uncertainty, the random part and the common one.
        lost_t: priced beside it (in gaps, and cycles without a mass), and the standard uncertainty
            of that.
        deviations: of payloads that are matched, over their standard uncertainty.
        invented: cycles found while the machine stood idle.
        idle_s: how long it did.
        withheld: why there are no masses.
    """

    seed: int
    mean_load_kg: float
    true: int
    hidden: int
    found: int
    right: int
    true_t: float
    true_counted_t: float
    found_t: float
    u_t: tuple[float, float]
    lost_t: tuple[float, float]
    deviations: tuple[float, ...]
    invented: int
    idle_s: float
    withheld: str = ""

    @property
    def f1(self) -> float:
        """Of all cycles."""
        return 2.0 * self.right / max(self.true + self.found, 1)

    @property
    def f1_seen(self) -> float:
        """Of the dumps that some log has."""
        return 2.0 * self.right / max(self.true - self.hidden + self.found, 1)

    @property
    def whole_u_t(self) -> float:
        """The standard uncertainty of the sum."""
        return float(np.hypot(*self.u_t))

    @property
    def error(self) -> float:
        """Of tonnes with what is priced, over the standard uncertainty of both."""
        u_t = float(np.hypot(self.whole_u_t, self.lost_t[1]))
        return (self.found_t + self.lost_t[0] - self.true_t) / u_t if u_t else float("nan")

    @property
    def error_counted(self) -> float:
        """Of the counted tonnes alone, against all that was dumped."""
        u_t = self.whole_u_t
        return (self.found_t - self.true_t) / u_t if u_t else float("nan")


def drawn_shift(
    seed: int, hours: float = 2.0, break_s: float = 0.0, *, physics: bool = False
) -> tuple[Scenario, Machine]:
    """A shift and the machine file of who reviews it: nuisances are as their priors have them.

    Args:
        seed: of everything.
        hours: of work.
        break_s: stand in the middle of it, beside those hours.
        physics: on real ground (`with_field_physics`), with loads that spill and pour.
    """
    for again in range(_TRIES):
        dice = np.random.default_rng([seed, again, 20_270])
        sections = _sections(dice, seed, hours, break_s)
        if physics:
            sections = _on_real_ground(sections, seed + 1000 * again)
        scenario = Scenario.model_validate(sections)
        assert scenario.shift is not None
        try:
            refuse_undrivable_shift(scenario, scenario.shift)
            if physics:
                steepest = _at_its_steepest(scenario)
                refuse_undrivable_shift(steepest, scenario.shift)
        except ScenarioError:
            continue
        stated = {
            "empty_mass_kg": scenario.machine.mass_kg,
            "force_gain_u": GAIN_U,
            "force_share_u": 0.0,
            "wheel_radius_u_m": RADIUS_U * scenario.machine.wheel_radius_m,
            "wheel_radius_by_load_u": 0.0,
        }
        machine = load_machine(YARD)
        body = machine.machine.model_copy(update=stated)
        return scenario, machine.model_copy(update={"machine": body})
    raise ScenarioError(f"seed {seed}: no machine of {_TRIES} can drive that shift")


def _sections(dice: np.random.Generator, seed: int, hours: float, break_s: float) -> Sections:
    prior = PriorSettings.model_validate({}).model_dump()

    def normal(std: float) -> float:
        return float(dice.normal(0.0, std))

    drawn: Sections = {
        part: {key: float(dice.uniform(*ends)) for key, ends in keys.items()}
        for part, keys in RANGES.items()
    }
    counts = {key: int(dice.integers(low, high + 1)) for key, (low, high) in COUNTS.items()}
    mass_kg = float(np.exp(dice.uniform(np.log(2800.0), np.log(5000.0))))
    size = mass_kg / LOADER_KG
    force_N = mass_kg * float(dice.uniform(1.5, 2.0))
    coulomb_N = abs(normal(prior["direction_share"] * force_N))
    slip = abs(normal(prior["wheel_slip"]))
    force_s, speed_s = normal(prior["lag_s"]), normal(prior["speed_delay_s"])
    first_s = min(0.0, force_s, speed_s)
    return {
        **drawn,
        "machine": {
            "mass_kg": mass_kg,
            "friction_N_s_m": mass_kg * float(dice.uniform(0.5, 1.0)),
            "inertia_z_kg_m2": 4000.0 * size,
            "friction_z_N_m_s": 5000.0 * size,
            "coulomb_N": coulomb_N,
            "slip_stiffness_N": force_N / slip if slip > 0.002 else 0.0,
            "wheel_radius_excess": normal(RADIUS_U),
        },
        "campaign": {"throttle_force_N": force_N, "valve_lag_s": float(dice.uniform(0.05, 0.15))},
        "shift": {
            **drawn["shift"],
            **counts,
            "duration_h": hours + break_s / 3600.0,
            "load_least_kg": LOADS_KG[0],
            "load_most_kg": LOADS_KG[1],
            "carry_back_most_kg": 100.0,
            "break_after_h": hours / 2.0 if break_s else 0.0,
            "break_s": break_s or 1800.0,
            "topics": ["boom"],
        },
        "sensors": {
            **drawn["sensors"],
            "seed": seed,
            "force_gain": 1.0 + normal(GAIN_U),
            "force_bias_N": normal(prior["const_share"] * force_N),
            "force_delay_s": force_s - first_s,
            "speed_delay_s": speed_s - first_s,
            "imu_delay_s": -first_s,
        },
        "defects": {"force_share_s2_m": normal(prior["load_transfer_s2_m"])},
    }


def _on_real_ground(sections: Sections, seed: int) -> Sections:
    """The shift with field physics, and in every third one each a load that spills or pours."""
    dice = np.random.default_rng([seed, 20_272])
    losing: Sections = {
        "shift": {
            "spill_1_s": float(dice.uniform(0.001, 0.01)) if dice.random() < 1 / 3 else 0.0,
            "pour_cycles": float(dice.uniform(0.1, 0.5)) if dice.random() < 1 / 3 else 0.0,
            "pour_share": float(dice.uniform(0.1, 0.25)),
        }
    }
    return join_designs(with_field_physics(sections, seed), losing)


def _at_its_steepest(scenario: Scenario) -> Scenario:
    """The shift on one slope, as steep as its hills are anywhere."""
    terrain = scenario.terrain
    steepest_deg = float(np.copysign(abs(terrain.slope_deg) + terrain.hills_deg, terrain.slope_deg))
    changed = terrain.model_copy(update={"slope_deg": steepest_deg})
    return scenario.model_copy(update={"terrain": changed})


def reviewed_shift(
    seed: int, folder: Path, hours: float = 2.0, break_s: float = 0.0, *, physics: bool = False
) -> ShiftFound:
    """Simulate a shift as MCAP logs, replay them in one time line, compare.

    Args:
        seed: of everything.
        folder: for the logs.
        hours: of work.
        break_s: see `drawn_shift`.
        physics: likewise.
    """
    scenario, machine = drawn_shift(seed, hours, break_s, physics=physics)
    logs = simulate_scenario_to_logs(scenario, folder / "shift.mcap", overwrites=True)
    truth = json.loads(make_shift_truth_path(folder / "shift.mcap").read_text(encoding="utf-8"))
    with ExitStack() as stack:
        made = run([stack.enter_context(open_log(path)) for path in logs], machine)
    assert scenario.shift is not None
    return beside_truth(seed, scenario.shift.load_kg, made, truth)


def beside_truth(seed: int, mean_load_kg: float, made: Run, truth: dict[str, list]) -> ShiftFound:
    """Match dumps, and add up.

    Args:
        seed: of the shift.
        mean_load_kg: of it.
        made: its replay.
        truth: as `payscope simulate` writes it.
    """
    t0 = made.provenance.t0_unix_ns
    cycles = made.frames["cycles"].filter(pl.col("dump_t_ns").is_not_null())
    mine = (cycles["dump_t_ns"].to_numpy() + t0) / _NS
    true = np.array([each["dump_ns"] for each in truth["cycles"]]) / _NS
    payload = np.array([each["payload_kg"] for each in truth["cycles"]])
    pairs = matched(mine, true)
    deviations = [
        (row["payload_kg"] - payload[there]) / row["payload_u_kg"]
        for here, there in pairs.items()
        if (row := cycles.row(here, named=True))["payload_u_kg"]
    ]
    aligned = made.frames["aligned"]
    here_s = (made.frames["excitation"]["t_ns"].to_numpy()[~aligned["gap"].to_numpy()] + t0) / _NS
    near = np.searchsorted(here_s, true).clip(1, here_s.size - 1)
    hidden = np.minimum(abs(true - here_s[near - 1]), abs(true - here_s[near])) > 1.0
    stands = [(s["start_ns"] / _NS, s["end_ns"] / _NS) for s in truth["stands"]]
    row = made.frames["shift"].row(0, named=True)
    withheld = made.frames["loads"]["withheld_for"][0] if not row["cycles_counted"] else ""
    return ShiftFound(
        seed,
        mean_load_kg,
        true.size,
        int(hidden.sum()),
        mine.size,
        len(pairs),
        float(payload.sum()) / 1e3,
        float(payload[list(pairs.values())].sum()) / 1e3,
        row["payload_kg"] / 1e3,
        (row["payload_u_random_kg"] / 1e3, row["payload_u_common_kg"] / 1e3),
        (
            (row["lost_kg"] + row["uncounted_kg"]) / 1e3,
            float(np.hypot(row["lost_u_kg"], row["uncounted_u_kg"])) / 1e3,
        ),
        tuple(map(float, deviations)),
        sum(any(begin < t < end for begin, end in stands) for t in mine.tolist()),
        float(sum(end - begin for begin, end in stands)),
        withheld or "",
    )


def matched(mine: np.ndarray, true: np.ndarray) -> dict[int, int]:
    """Of each found time the true one that it is, the nearest pairs first, one to one."""
    far = np.abs(mine[:, None] - true[None, :])
    pairs: dict[int, int] = {}
    for flat in np.argsort(far, axis=None, kind="stable"):
        here, there = divmod(int(flat), true.size)
        if far[here, there] > MATCHED_S:
            break
        if here not in pairs and there not in pairs.values():
            pairs[here] = there
    return pairs
