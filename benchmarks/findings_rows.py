"""The logs of `make findings`: clean ones, ones with a fault of a size, and ones with two.

A log is drawn from a seed; half of them have what the model does not describe, and no fault.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import polars as pl

from analysis.model.machine import Channel, Machine
from analysis.model.run_record import Run
from analysis.model.schema import get_column_values
from analysis.simulation import Scenario, SimulatedLog, simulate_campaign
from benchmarks.weighed import machine
from replay.inputs.derived_logs import MemoryLog, copy_machine_with_simulated_channels
from replay.pipeline import run
from tests.trials.drawn_designs import (
    Sections,
    draw_design,
    join_designs,
    with_field_physics,
)
from tests.trials.fault_injection import Fault, with_fault

#: Axes that tell more causes apart than the loader's machine file needs.
AXES: Final = ("specific_force_y_m_s2", "specific_force_z_m_s2", "pitch_rad")
#: Whatever the verdict, the mass is to be seen.
OPEN: Final = tuple(
    f"settings.verdict.{name}={value}"
    for name, value in {
        "partial_correlation_min": -1.0,
        "relative_std_max": 1e9,
        "r_squared_min": -1e9,
        "opposing_share_min": 0.0,
        "driving_share_min": 0.0,
        "acceleration_gain_min": -1e9,
        "acceleration_gain_max": 1e9,
        "force_sign_min": -1.0,
        "gated_max": 1e9,
        "friction_t_min": -1e9,
        "channel_noise_max": 1.0,
        "lag_max_s": 1e9,
        "gain_max": 1e9,
        "beyond_prior_max": 1e9,
        "filling_max": 1e9,
        "wheels_max": 1e9,
        "scatter_max": 1e9,
        "frozen_max_s": 1e9,
        "clipped_max": 1.0,
        "sides_max": 1e9,
        "one_sided_max": 1e9,
        "clocks_max_s": 1e9,
        "imu_tilt_max_deg": 180.0,
        "accepted_stretches_min": 0,
        "empty_mass_ratio_min": 0.0,
        "empty_mass_ratio_max": 1e9,
        "negative_payload_max_u": 1e9,
        "causes_max": 100,
    }.items()
)
POOLED: Final = 'settings.trace.methods=["pooled"]'


#: Parts of an odd design that are causes: they are found, and rightly.
_CAUSES: Final = frozenset({"loading", "rolling"})


@dataclass(frozen=True)
class Found:
    """What a log's findings say.

    Attributes:
        causes: of the findings in their order, each with those it cannot be told from.
        mass_kg: of the answer, None where there is none.
        pooled_kg: of the paper's estimate by manoeuvre, in their mean.
        u_random_kg: what noise does to the answer.
        changes: what each finding claims: cause, kg, standard uncertainty.
        settings: keys and values of each finding that proposes any.
    """

    causes: tuple[tuple[str, ...], ...]
    mass_kg: float | None
    pooled_kg: float | None
    u_random_kg: float | None
    changes: tuple[tuple[str, float, float], ...]
    settings: tuple[tuple[str, str, str], ...]

    def place(self, causes: Sequence[str]) -> int | None:
        """Where the first of these causes is named, from 1 on, by itself or with its class."""
        for number, named in enumerate(self.causes, 1):
            if set(named) & set(causes):
                return number
        return None


def design(seed: int, *, odd: bool) -> Sections:
    """A machine and its campaign, of 75 s at least; an odd one is not as the model has it."""
    dice = np.random.default_rng([seed, 20_266])
    found = draw_design(seed)
    campaign = found["campaign"]
    one_s = campaign["standstill_s"] + campaign["start_s"] + campaign["cruise_s"] + 1.5
    campaign["runs"] = max(campaign["runs"], int(np.ceil(75.0 / one_s)))
    if not odd:
        return found
    size = found["machine"]["mass_kg"] / 3614.0
    # what an accelerometer is biased and tilted by is a cause, and no odd machine
    field = with_field_physics(found, seed)
    warming = ("friction_warming", "warming_s")
    kinds: list[dict[str, dict[str, Any]]] = [
        {"starts": {"stick_share": float(dice.uniform(0.05, 0.3))}},
        {"chassis": {"boom_kg": 50.0 * size}},
        {"campaign": {"valve_deadband_share": float(dice.uniform(0.0, 0.15))}},
        {"drivetrain": {"rotating_kg": 150.0 * size}},
        {"drivetrain": {"efficiency": float(dice.uniform(0.85, 1.0))}},
        {"terrain": {"slope_deg": float(dice.uniform(-3.0, 3.0))}},
        {"terrain": {"hills_deg": 1.5, "hills_length_m": float(dice.uniform(20.0, 60.0))}},
        {"loading": {"change_kg": 250.0 * size, "change_before_start": campaign["runs"] // 2}},
        {"sensors": {"speed_lsb_m_s": 0.001, "acc_lsb_m_s2": 0.002}},
        {"starts": {"throttle_least": 1.0}},
        {"rolling": field["rolling"]},
        {"machine": {name: field["machine"][name] for name in warming}},
        {"chassis": field["chassis"]},
        {"brakes": field["brakes"]},
    ]
    chosen = dice.choice(len(kinds), 2, replace=False)
    return join_designs(found, *(kinds[int(number)] for number in chosen))


def without_causes(sections: Sections) -> Sections:
    """The design without what is a cause and is found: a load that changes, rolling resistance."""
    return {name: each for name, each in sections.items() if name not in _CAUSES}


def own_machine(scenario: Scenario, overrides: Sequence[str], axes: Sequence[str]) -> Machine:
    """The machine file of a simulated machine, with further axes of its IMU."""
    loaded = machine((POOLED, *OPEN, *overrides))
    body = loaded.machine.model_copy(
        update={
            "empty_mass_kg": scenario.machine.mass_kg,
            "force_share": scenario.machine.force_share,
        }
    )
    channels = {**loaded.channels, **{name: Channel(topic="imu", field=name) for name in axes}}
    return loaded.model_copy(update={"machine": body, "channels": channels})


def simulated(sections: Sections, faults: Sequence[tuple[Fault, float]]) -> list[SimulatedLog]:
    """The logs of a design with faults of a size each."""
    whole = join_designs(sections, *(fault.sections(sections, size) for fault, size in faults))
    last = max((fault.last_runs for fault, _ in faults), default=0)
    if not last:
        logs = list(simulate_campaign(Scenario.model_validate(whole)))
    else:
        # the runs before it are another log of the same time line
        campaign = whole["campaign"]
        part = [fault.sections(sections, size) for fault, size in faults if not fault.last_runs]
        before = {"campaign": {**campaign, "runs": campaign["runs"] - last}}
        after = {"campaign": {**campaign, "runs": last}}
        logs = list(
            simulate_campaign(Scenario.model_validate(join_designs(sections, *part, before)))
        )
        begin = int(logs[0].timeline.end_ns // 10**9) + 60
        later = join_designs(whole, after, {"log": {"start_unix_s": begin}})
        later["sensors"] = {**later["sensors"], "seed": later["sensors"]["seed"] + 500_000_000}
        logs += list(simulate_campaign(Scenario.model_validate(later)))
    for fault, size in faults:
        logs = [with_fault(log, fault, size, sections["sensors"]["seed"]) for log in logs]
    return logs


def needed(sections: Sections, faults: Sequence[Fault]) -> Sections:
    """The design with what faults need to be seen."""
    for fault in faults:
        sections = join_designs(sections, fault.needs)
    return sections


def replayed(
    sections: Sections,
    faults: Sequence[tuple[Fault, float]] = (),
    axes: Sequence[str] = AXES,
    overrides: Sequence[str] = (),
) -> Run:
    """Simulate a design with faults, and replay it."""
    logs = simulated(sections, faults)
    also = [override for fault, _ in faults for override in fault.overrides]
    own = own_machine(logs[0].scenario, [*also, *overrides], axes)
    return run([MemoryLog(log) for log in logs], copy_machine_with_simulated_channels(own, logs[0]))


def found(replay: Run) -> Found:
    """The findings of a run beside its masses."""
    rows = replay.frames["findings"].to_dicts()
    load = replay.frames["loads"].row(0, named=True)
    segments = replay.frames["segments"].filter(pl.col("mass_kg").is_finite())
    mass_kg, std_kg = (get_column_values(segments, name) for name in ("mass_kg", "mass_std_kg"))
    pooled = float(np.average(mass_kg, weights=std_kg**-2.0)) if mass_kg.size else None
    return Found(
        causes=tuple(
            (row["cause"], *(each for each in row["alternatives"].split(", ") if each))
            for row in rows
        ),
        mass_kg=load["mass_kg"],
        pooled_kg=pooled,
        u_random_kg=load["u_random_kg"],
        changes=tuple(
            (row["cause"], row["mass_change_kg"], row["mass_change_u_kg"])
            for row in rows
            if row["mass_change_kg"] is not None
        ),
        settings=tuple(
            (row["cause"], row["setting"], row["value"]) for row in rows if row["setting"]
        ),
    )
