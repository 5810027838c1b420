"""The logs of `make honesty`: faulty rows, clean designs, power-limited motors.

A task is one log: it says what is simulated and how it is replayed, and is run by any process.
"""

import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from analysis.model.prior_settings import PriorSettings
from benchmarks.weighed import DERIVED, Weighed, weighed
from estimators.errors import ScenarioError
from tests.trials.drawn_designs import (
    Sections,
    brought_to_size,
    draw_design,
    join_designs,
    with_field_physics,
)
from tests.trials.situations import HARMLESS, INSTRUMENTS, MACHINE, WITHHELD

POOLED = 'settings.trace.methods=["pooled"]'
BRAKING = "settings.gate.exclude_braking=false"
LOADER: Sections = {
    "machine": {"mass_kg": 3614.0},
    "campaign": {"loads_kg": [0.0], "runs": 9, "throttle_force_N": 6000.0},
}
#: The fit's terms are to take these out.
INSIDE = (
    *("Coulomb friction 100 N", "Coulomb friction 300 N", "slip 80 kN"),
    *("force offset +300 N", "force offset -300 N", "accelerometer tilted 1°"),
    *("force late 10 ms", "force late 20 ms", "topics 9 ms out of phase"),
)


@dataclass(frozen=True)
class Row:
    """A kind of log.

    Attributes:
        name: in the table.
        group: faulty, budget (a scale error that the machine file knows of), harmless or withheld.
        situation: sections of a scenario, on the loader.
        overrides: of the machine file.
        body: what else the machine file states, on the loader.
    """

    name: str
    group: str
    situation: Mapping[str, Mapping[str, Any]]
    overrides: tuple[str, ...] = ()
    body: Mapping[str, float] = field(default_factory=dict)


_BUDGET = {
    "torque scale +10 %": {"force_gain_u": 0.1},
    "torque scale -10 %": {"force_gain_u": 0.1},
    "efficiency 90 %": {"force_gain_u": 0.1},
    "rotating parts": {"rotating_mass_kg": 120.0, "rotating_mass_u_kg": 40.0},
    "share grows with the load": {"force_share_u": 0.02},
}
#: Measured wheels that carry a part of the force, or there is no share to change.
_HALF = {"machine": {"force_share": 0.5}}
_ONE_THROTTLE = {"starts": {"throttle_least": 1.0}}
_HARMLESS_TOO = ("surge resonance 2 Hz", "surge resonance 4 Hz")


def rows() -> list[Row]:
    found: list[Row] = []
    faulty = {**MACHINE, **INSTRUMENTS, "force late 20 ms": {"sensors": {"force_delay_s": 0.02}}}
    for name, situation in faulty.items():
        group = "faulty"
        group = "harmless" if name in _HARMLESS_TOO else "budget" if name in _BUDGET else group
        whole = join_designs(situation, _HALF) if name.startswith("share") else situation
        whole = join_designs(whole, _ONE_THROTTLE) if "campaign" in situation else whole
        overrides = (BRAKING,) if name.startswith("brakes seen") else ()
        shown = f"{name}, braking included" if overrides else name
        found.append(Row(shown, group, whole, overrides, _BUDGET.get(name, {})))
    coulomb = "settings.forces.coulomb=true"
    part = {"campaign": {"brake_measured_share": 0.4}}
    found += [
        Row(
            "Coulomb friction 300 N, coulomb = true",
            "faulty",
            MACHINE["Coulomb friction 300 N"],
            (coulomb,),
            {},
        ),
        Row("slip 80 kN, coulomb = true", "faulty", MACHINE["slip 80 kN"], (coulomb,), {}),
        Row("acceleration derived from speed", "faulty", {}, DERIVED, {}),
        *(
            Row(
                f"slip {kN} kN, acceleration derived from speed",
                "faulty",
                {"machine": {"slip_stiffness_N": 1e3 * kN}},
                DERIVED,
                {},
            )
            for kN in (80, 40)
        ),
        Row("brakes seen to 40 %, braking included", "faulty", part, (BRAKING,), {}),
    ]
    found += [Row(name, "harmless", each, (), {}) for name, each in HARMLESS.items()]
    found += [Row(name, "withheld", each, (), {}) for name, each in WITHHELD.items()]
    return found


ROWS = {row.name: row for row in rows()}


@dataclass(frozen=True)
class Task:
    """One log.

    Attributes:
        kind: row, clean or power.
        name: of the row, or of the kind of clean log.
        design: "loader", or "drawn".
        seed: of design and noise.
    """

    kind: str
    name: str
    design: str
    seed: int


def row_tasks(seeds: int) -> Iterator[Task]:
    """So many logs a row on the loader, and as many on machines that are drawn."""
    for number in range(seeds):
        for name in ROWS:
            own = zlib.crc32(name.encode()) % 100_000
            yield Task("row", name, "loader", 1_000_000 + 1000 * own + number)
            yield Task("row", name, "drawn", 2_000_000 + 1000 * own + number)


def row_log(task: Task) -> Weighed:
    row = ROWS[task.name]
    overrides = (POOLED, *row.overrides)
    if task.design == "loader":
        whole = join_designs(LOADER, {"sensors": {"seed": task.seed}}, row.situation)
        return weighed(row.name, "loader", whole, overrides, body=row.body)
    for again in range(20):
        design = draw_design(task.seed + 500 * again)
        if row.name == "cruise only":  # an arc, which is no start
            design.pop("starts")
        whole = join_designs(design, brought_to_size(row.situation, design))
        size = design["machine"]["mass_kg"] / LOADER["machine"]["mass_kg"]
        body = {k: v * size if k.endswith("_kg") else v for k, v in row.body.items()}
        try:
            return weighed(row.name, "drawn", whole, overrides, body=body)
        except ScenarioError:
            continue
    raise ScenarioError(f"{task.name}: no machine of twenty can do that")


CLEAN = ("nuisances from their priors", "nuisances at zero")
WIDTHS = ("nine starts, force_share = 1", "nine starts, force_share = 0.5")
NARROW = ("narrow priors, force_share = 1", "narrow priors, force_share = 0.5")
_NARROWED = (
    *("const_share", "lag_s", "lag_drift_s", "wheel_slip", "quadratic_share"),
    *("direction_share", "speed_delay_s", "const_weight_share", "direction_weight_share"),
    *("gain", "load_transfer_s2_m"),
)


#: Clean machines, each in as many logs as there are seeds.
DESIGNS = 18


def clean_tasks(seeds: int) -> Iterator[Task]:
    """Every clean machine with its nuisances and without."""
    for number in range(seeds):
        for design in range(DESIGNS):
            for name in CLEAN:
                yield Task("clean", name, f"design {design}", 3_000_000 + 1000 * design + number)


def width_tasks(seeds: int) -> Iterator[Task]:
    """The loader as the model has it, with priors as they are and narrow ones."""
    for number in range(seeds):
        for name in (*WIDTHS, *NARROW):
            yield Task("width", name, "loader", 4_000_000 + number)


def width_log(task: Task) -> Weighed:
    share = 1.0 if task.name.endswith("= 1") else 0.5
    whole = join_designs(
        LOADER, {"machine": {"force_share": share}, "sensors": {"seed": task.seed}}
    )
    overrides: list[str] = [POOLED]
    if task.name in NARROW:
        priors = machine_priors()
        overrides += [f"settings.priors.{name}={priors[name] / 50:.6g}" for name in _NARROWED]
    return weighed(task.name, "loader", whole, tuple(overrides))


def machine_priors() -> dict[str, float]:
    """The widths of the priors by name."""
    return PriorSettings.model_validate({}).model_dump()


def clean_log(task: Task) -> Weighed:
    """A log of the design's machine, whose noise and nuisances are this seed's."""
    number = int(task.design.split()[1])
    design = join_designs(draw_design(5_000_000 + number), {"sensors": {"seed": task.seed}})
    if task.name == "nuisances at zero":
        return weighed(task.name, task.design, design, (POOLED,))
    dice = np.random.default_rng([task.seed, 20_262])
    for _ in range(20):
        nuisances, acc_gain = _nuisances(design, dice)
        try:
            whole = join_designs(design, nuisances)
            return weighed(task.name, task.design, whole, (POOLED,), acc_gain)
        except ScenarioError:
            continue
    raise ScenarioError("no nuisances of twenty leave a machine that drives")


def _nuisances(design: Sections, dice: np.random.Generator) -> tuple[Sections, float]:
    """Nuisances as their priors have them, and a gain of the accelerometer."""
    prior = machine_priors()
    campaign, body = design["campaign"], design["machine"]
    force_N = campaign["throttle_force_N"]

    def normal(std: float) -> float:
        return float(dice.normal(0.0, std))

    both_ways = design["starts"]["directions"] == "alternating"
    const_N = prior["const_share"] * force_N
    # one way a constant is offset and friction together
    bias_N = normal(const_N if both_ways else const_N * 0.8)
    coulomb_N = abs(normal(prior["direction_share"] * force_N if both_ways else const_N * 0.6))
    slip = abs(normal(prior["wheel_slip"]))
    force_s, speed_s = normal(prior["lag_s"]), normal(prior["speed_delay_s"])
    first_s = min(0.0, force_s, speed_s)
    period_s = campaign["standstill_s"] + campaign["start_s"] + campaign["cruise_s"] + 1.5
    drift_s = float(np.clip(normal(prior["lag_drift_s"]), -0.03, 0.03))
    share = normal(prior["load_transfer_s2_m"]) if body["force_share"] < 1.0 else 0.0
    sections: Sections = {
        "machine": {
            "coulomb_N": coulomb_N,
            "slip_stiffness_N": force_N / slip if slip > 0.002 else 0.0,
        },
        "sensors": {
            "force_bias_N": bias_N,
            "force_delay_s": force_s - first_s,
            "speed_delay_s": speed_s - first_s,
            "imu_delay_s": -first_s,
        },
        "sampling": {"torque_clock_ppm": 1e6 * drift_s / (campaign["runs"] * period_s)},
        "defects": {"force_share_s2_m": share},
    }
    return sections, 1.0 + normal(prior["gain"])


LOADS = (
    "nuisances from their priors, loads change",
    "nine empty and nine with 250 kg",
    "one and one",
    "starts scatter as much as their noise, the empty ones named",
    "starts scatter three times their noise, the empty ones named",
    "field physics, half loaded",
)


EMPTY_FIRST = ("settings.loads.empty_from_s=0.0", "settings.loads.empty_to_s=30.0")
#: How starts scatter, over their own noise.
_SCATTERS = {LOADS[3]: 1.0, LOADS[4]: 3.0}
#: What one start says of the loader by its noise, and of a machine of another size likewise.
_NOISE_SHARE = 15.0 / 3614.0


def load_tasks(logs: int) -> Iterator[Task]:
    """Machines that are loaded several times in one time line."""
    for number in range(logs):
        for kind, name in enumerate(LOADS):
            yield Task("loads", name, "drawn", 7_000_000 + 10_000 * kind + number)


def load_log(task: Task) -> Weighed:
    """Empty and one to four loads, two to six starts each; or the loader, empty and with 250 kg."""
    dice = np.random.default_rng([task.seed, 20_264])
    if task.name == LOADS[5]:
        return field_log(task, dice)
    if task.name != LOADS[0]:
        runs = 9 if task.name == LOADS[1] else 1
        loader = {
            "campaign": {"loads_kg": [0.0, 250.0], "runs": runs},
            "sensors": {"seed": task.seed},
        }
        # one start tells no repeatability, nor which of two is empty
        known = {} if runs > 1 else {"repeatability_kg": 1.0}
        said = () if runs > 1 else EMPTY_FIRST
        return weighed(
            task.name, "loader", join_designs(LOADER, loader), (POOLED, *said), body=known
        )
    scatter = _SCATTERS.get(task.name, 0.0)
    said = EMPTY_FIRST if scatter else ()
    for again in range(20):
        design = draw_design(task.seed + 500 * again)
        size = design["machine"]["mass_kg"] / LOADER["machine"]["mass_kg"]
        loads = size * dice.uniform(20.0, 250.0, int(dice.integers(1, 5)))
        campaign = {"loads_kg": [0.0, *loads.tolist()], "runs": int(dice.integers(3, 7))}
        nuisances, acc_gain = _nuisances(design, dice)
        try:
            # each log has its own clock: none drifts, or the drift would begin anew with each
            one_clock = {"campaign": campaign, "sampling": {"torque_clock_ppm": 0.0}}
            whole = join_designs(join_designs(design, nuisances), one_clock)
            whole = join_designs(whole, _scattering(design, scatter)) if scatter else whole
            return weighed(task.name, "drawn", whole, (POOLED, *said), acc_gain)
        except ScenarioError:
            continue
    raise ScenarioError(f"{task.seed}: no machine of twenty can do that")


def field_log(task: Task, dice: np.random.Generator) -> Weighed:
    """A machine on real ground, empty in one half of its starts and loaded in the other."""
    for again in range(20):
        design = draw_design(task.seed + 500 * again)
        mass_kg = design["machine"]["mass_kg"]
        half = int(dice.integers(3, 8))
        nuisances, acc_gain = _nuisances(design, dice)
        loaded = {
            "campaign": {"loads_kg": [0.0], "runs": 2 * half},
            "loading": {
                "change_kg": mass_kg * float(dice.uniform(0.02, 0.25)),
                "change_before_start": half,
            },
        }
        whole = with_field_physics(join_designs(design, nuisances, loaded), task.seed + 500 * again)
        try:
            return weighed(task.name, "drawn", whole, (POOLED,), acc_gain)
        except ScenarioError:
            continue
    raise ScenarioError(f"{task.seed}: no machine of twenty can do that")


def _scattering(design: Sections, scatter: float) -> Sections:
    """Friction that differs from start to start, so that masses do by so many of their noise."""
    std_N = scatter * _NOISE_SHARE * design["campaign"]["throttle_force_N"]
    # none is below zero
    return {"machine": {"coulomb_N": 3.0 * std_N}, "starts": {"coulomb_std_N": std_N}}


POWER = "power-limited motor, acceleration derived"


def power_tasks(logs: int) -> Iterator[Task]:
    for number in range(logs):
        yield Task("power", POWER, "drawn", 6_000_000 + number)


def power_log(task: Task) -> Weighed:
    """A motor whose force follows from the speed for most of a start, on a soft driveline."""
    dice = np.random.default_rng([task.seed, 20_263])
    design = draw_design(task.seed)
    full_N = design["campaign"]["throttle_force_N"]
    power = {
        "campaign": {"runs": round(float(np.exp(dice.uniform(0.0, np.log(30.0)))))},
        "drivetrain": {
            "power_limit_W": full_N * float(dice.uniform(0.2, 0.7)),
            "resonance_hz": float(dice.uniform(3.0, 6.0)),
            "resonance_damping": float(dice.uniform(0.03, 0.3)),
        },
    }
    return weighed(POWER, "drawn", join_designs(design, power), DERIVED)


KINDS = {
    "row": row_log,
    "clean": clean_log,
    "width": width_log,
    "power": power_log,
    "loads": load_log,
}


def log(task: Task) -> Weighed:
    """Simulate and weigh a task's log."""
    return KINDS[task.kind](task)
