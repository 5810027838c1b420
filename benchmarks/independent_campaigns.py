"""Campaigns of one day on the independent plant, and later logs of a machine that has changed.

    python -P benchmarks/independent_campaigns.py [--campaigns 60] [--first 0] [--json FILE]

A machine is drawn once a campaign: six loads, a log of nine starts each, all of one day. Then logs
of nine and of three starts as the campaign was driven, and with one thing changed each; and logs
of three starts empty and three with a load, whose payload is a difference. `--json` keeps a line a
campaign as it comes and goes on where it ended.
"""

import json
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Final, NamedTuple

import numpy as np
import polars as pl
import typer

from analysis.calibration.campaign.campaign_plan import CampaignRun
from analysis.calibration.campaign.campaign_readings import (
    make_readings_of_campaign_runs,
    make_run_changes_per_learnt_mean_u,
)
from analysis.calibration.line.calibration import Calibration, CalibrationOptions
from analysis.calibration.line.line_fit import fit_calibration_line
from analysis.calibration.use.apply_calibration import calibrate_loads, collect_later_log_facts
from analysis.calibration.use.learnt_priors import (
    copy_machine_estimating_learnt_mean_errors,
    copy_machine_with_learnt_priors,
    list_learnable_term_estimates,
    pool_learnt_terms_over_logs,
)
from analysis.model.machine import Machine
from analysis.model.run_record import Run
from benchmarks.independent.legs import DRIVE, STAND, WHOLE_LEG, Leg
from benchmarks.independent.machine import Plant
from benchmarks.independent.machine_file import Known, write_machine_file
from benchmarks.independent.mcap_log import write_mcap
from benchmarks.independent.payload_plans import drawn_instruments
from benchmarks.independent.plant import drive
from benchmarks.independent.sensors import Instruments, measured
from benchmarks.page import markdown
from replay import load_machine, open_log, run

#: Loads of a campaign, and of later logs, as shares of the machine.
LOADS_1: Final = (0.0, 0.014, 0.028, 0.042, 0.056, 0.07)
#: Half an interval of 15 kg is narrow on a machine of 3614 kg, whose range is 250 kg.
NARROW_1: Final = 15.0 / 3614.0
CHANGES: Final = (
    *("unchanged", "bias 0.05", "rolling +1 %", "gain +1 %", "throttle 60 %"),
    *("other ways", "slope 2"),
)
#: Relative standard deviation of the gain of the force; the machine file states it.
GAIN_STD: Final = 0.03
_DAY: Final = "2026-05-01"
_NEVER_S: Final = 900.0


class Way(NamedTuple):
    """How a log is driven."""

    throttle: tuple[float, float]
    alternates: bool
    start_s: float


class Drawn(NamedTuple):
    """A machine, its instruments and its driver.

    Attributes:
        plant: the machine.
        seen: its instruments.
        way: how it is driven.
        stated: the instruments as the machine file has them; None: as they are.
        known: what else it states; None: the empty mass alone.
    """

    plant: Plant
    seen: Instruments
    way: Way
    stated: Instruments | None = None
    known: Known | None = None


def drawn_machine(dice: np.random.Generator) -> Drawn:
    """Draw a machine that starts on 2 % more rolling resistance and a slope of 2 degrees."""
    mass_kg = float(np.exp(dice.uniform(*np.log([1500.0, 8000.0]))))
    force_N = mass_kg * float(dice.uniform(1.5, 2.2))
    plant = Plant(
        mass_kg,
        mass_kg * float(dice.uniform(0.3, 1.0)),
        force_N,
        coulomb_N=force_N * float(dice.uniform(0.0, 0.03)),
        rolling_1=float(dice.uniform(0.0, 0.015)),
        drive_lag_s=float(dice.uniform(0.08, 0.25)),
        stick_share=float(dice.uniform(0.0, 0.06)),
    )
    plant = plant._replace(rolling_far_1=plant.rolling_1)
    size = mass_kg / 3600.0
    seen = drawn_instruments(dice, mass_kg)._replace(
        force_gain=float(np.exp(dice.normal(0.0, GAIN_STD))),
        force_offset_N=float(dice.normal(0.0, 60.0)) * size,
        acc_bias_m_s2=float(dice.normal(0.0, 0.02)),
    )
    least = float(dice.uniform(0.6, 0.9))
    way = Way((least, 1.0), bool(dice.random() < 0.5), float(dice.uniform(2.0, 3.5)))
    return Drawn(plant, seen, way)


def changed(drawn: Drawn, change: str) -> Drawn:
    """The same machine on another day."""
    plant, seen, way = drawn.plant, drawn.seen, drawn.way
    if change == "bias 0.05":
        seen = seen._replace(acc_bias_m_s2=seen.acc_bias_m_s2 + 0.05)
    elif change == "rolling +1 %":
        more = plant.rolling_1 + 0.01
        plant = plant._replace(rolling_1=more, rolling_far_1=more)
    elif change == "gain +1 %":
        seen = seen._replace(force_gain=1.01 * seen.force_gain)
    elif change == "throttle 60 %":
        least, most = way.throttle
        way = way._replace(throttle=(0.6 * least, 0.6 * most))
    elif change == "other ways":
        way = way._replace(alternates=not way.alternates)
    elif change == "slope 2":
        plant = plant._replace(slope_rad=float(np.deg2rad(2.0)))
    return Drawn(plant, seen, way)


def machine_as_calibrated(own: Machine, calibrated_machine: Machine) -> Machine:
    """Give a machine the learnt priors of another, and the way in which that uses them."""
    priors = calibrated_machine.settings.priors
    own = copy_machine_with_learnt_priors(own, priors.learnt)
    return copy_machine_estimating_learnt_mean_errors(own) if priors.learnt_means == "told" else own


def replayed(
    drawn: Drawn,
    states: tuple[tuple[float, int], ...],
    dice: np.random.Generator,
    machine: Machine | None,
) -> tuple[Run, Machine]:
    """Drive, measure, replay.

    Args:
        drawn: the machine.
        states: load in kg and number of starts, one after another; the first of several is empty.
        dice: of this log.
        machine: settings of the replay; None: as its machine file is drafted.
    """
    legs: list[Leg] = []
    for place, (load_kg, starts) in enumerate(states):
        for number in range(starts):
            stand_s = float(dice.uniform(3.0, 5.0)) + (10.0 if place and not number else 0.0)
            stand = Leg(
                STAND,
                duration_s=stand_s,
                load_to_kg=load_kg,
                load_rate_kg_s=2.0 * max(load_kg, 1.0) / stand_s,
                load_when=WHOLE_LEG,
            )
            going = Leg(
                DRIVE,
                direction=-1.0 if drawn.way.alternates and number % 2 else 1.0,
                throttle=float(dice.uniform(*drawn.way.throttle)),
                rise_s=float(dice.uniform(0.15, 0.6)),
                start_s=drawn.way.start_s * float(dice.uniform(0.85, 1.15)),
                cruise_s=float(dice.uniform(1.0, 3.0)),
                brake_m_s2=float(dice.uniform(0.6, 1.5)),
            )
            legs += [stand, going]
    legs.append(Leg(STAND, duration_s=3.0))
    motion = drive(drawn.plant, legs, _NEVER_S)
    empty_s = None
    if len(states) > 1:
        first = 2 * states[0][1]
        empty_s = (0.0, float(np.mean(motion.leg_starts_s[first : first + 2])))
    empty_kg = drawn.plant.mass_kg
    with tempfile.TemporaryDirectory() as folder:
        path, stated = Path(folder) / "log.mcap", Path(folder) / "machine.toml"
        write_mcap(measured(dice, drawn.seen, motion, empty_kg), path)
        known = drawn.known or Known(empty_kg, 0.0005 * empty_kg, GAIN_STD)
        write_machine_file(stated, drawn.stated or drawn.seen, known._replace(empty_s=empty_s))
        own = load_machine(stated)
        if machine is not None:
            own = machine_as_calibrated(own, machine)
        with open_log(path) as opened:
            return run(opened, own), own


def calibrated(
    drawn: Drawn, dice: np.random.Generator, loads_1: Sequence[float] = LOADS_1
) -> tuple[Calibration, Machine] | str:
    """The campaign's line and its machine with learnt priors; else why there is none."""
    mass_kg = drawn.plant.mass_kg
    # the same logs twice: every log has dice of its own
    seeds = dice.integers(0, 2**62, len(loads_1))
    states = [((share * mass_kg, 9),) for share in loads_1]
    logs = [(state, np.random.default_rng(seed)) for state, seed in zip(states, seeds, strict=True)]
    raw = [replayed(drawn, state, own, None) for state, own in logs]
    said = [
        term
        for number, (each, _) in enumerate(raw)
        if not each.frames["loads"]["withheld"].any()
        for term in list_learnable_term_estimates(str(number), each.frames["nuisances"])
    ]
    machine = copy_machine_with_learnt_priors(raw[0][1], pool_learnt_terms_over_logs(said))
    logs = [(state, np.random.default_rng(seed)) for state, seed in zip(states, seeds, strict=True)]
    again = [replayed(drawn, state, own, machine)[0] for state, own in logs]
    runs = [
        CampaignRun.model_validate({"id": f"run-{k}", "log": f"{k}", "loads": (), "day": _DAY})
        for k in range(len(loads_1))
    ]
    tables = [
        make_readings_of_campaign_runs(each, [about], "joint_mass").with_columns(
            load_id=pl.lit(about.log)
        )
        for each, about in zip(again, runs, strict=True)
    ]
    responses = [
        one
        for each, about in zip(again, runs, strict=True)
        for one in make_run_changes_per_learnt_mean_u(each, [about], "joint_mass")
    ]
    reference_kg = mass_kg * (1.0 + np.array(loads_1))
    known = pl.DataFrame({"load_id": [r.log for r in runs], "reference_kg": reference_kg})
    u_kg2 = np.eye(len(runs)) * (0.0001 * mass_kg) ** 2
    options = CalibrationOptions("joint_mass")
    try:
        line = fit_calibration_line(pl.concat(tables), known, u_kg2, options, responses)
    except ValueError as fault:
        return str(fault)
    return line, copy_machine_estimating_learnt_mean_errors(machine)


def later(
    drawn: Drawn,
    states: tuple[tuple[float, int], ...],
    by: tuple[Calibration, Machine],
    dice: np.random.Generator,
) -> dict[str, Any]:
    """What the last load of a later log comes to."""
    line, machine = by
    made, own = replayed(drawn, states, dice, machine)
    log = collect_later_log_facts(made.frames, own.machine)
    row = calibrate_loads(made.frames["loads"], line, log).row(-1, named=True)
    names = ["payload_kg", "payload_u_kg", "mass_kg", "u_kg"]
    names += [name for name in row if name.startswith("calibrated_")]
    return {
        "load_kg": states[-1][0],
        "starts": states[-1][1],
        "withheld": row["withheld_for"],
        **{name: row[name] for name in names},
    }


def campaign(seed: int) -> dict[str, Any]:
    """A machine, its line, and all later logs."""
    dice = np.random.default_rng([seed, 49_001])
    drawn = drawn_machine(dice)
    by = calibrated(drawn, dice)
    mass_kg = drawn.plant.mass_kg
    about = {"seed": seed, "mass_kg": mass_kg, "rolling_1": drawn.plant.rolling_1}
    if isinstance(by, str):
        return {**about, "no_line": by, "masses": {}, "payloads": {}}
    masses: dict[str, list[dict[str, Any]]] = {}
    payloads: dict[str, dict[str, Any]] = {}
    for number, change in enumerate(CHANGES):
        other = changed(drawn, change)
        counts = (9, 3) if change == "unchanged" else ((9,) if (seed + number) % 2 else (3,))
        load_kg = mass_kg * float(dice.uniform(0.01, 0.06))
        masses[change] = [later(other, ((load_kg, n),), by, dice) for n in counts]
        payloads[change] = later(other, ((0.0, 3), (load_kg, 3)), by, dice)
    line = by[0]
    shown = {"U_kg": line.coverage_k_1 * line.u_kg, "common_kg": line.common_kg}
    return {**about, "no_line": "", **shown, "masses": masses, "payloads": payloads}


def outcome(row: Mapping[str, Any], mass_kg: float, what: str) -> tuple[str, float, float]:
    """Held, refused, warned or wrong; half of the interval and the error over it."""
    name = "calibrated_payload" if what == "payload" else "calibrated"
    true_kg = row["load_kg"] + (0.0 if what == "payload" else mass_kg)
    value = row[f"{name}_kg"]
    if value is None:
        return "refused", float("nan"), float("nan")
    half_kg = (row[f"{name}_high_kg"] - row[f"{name}_low_kg"]) / 2.0
    if row[f"{name}_low_kg"] <= true_kg <= row[f"{name}_high_kg"]:
        return "held", half_kg, (value - true_kg) / half_kg
    return "warned" if row["calibrated_said"] else "wrong", half_kg, (value - true_kg) / half_kg


def table(found: list[dict[str, Any]]) -> str:
    """A row a change and what is weighed."""
    rows: list[list[str]] = []
    for what in ("mass", "payload"):
        for change in CHANGES:
            for starts in (9, 3):
                said: list[tuple[str, float, float]] = []
                narrow: list[bool] = []
                for each in found:
                    own = (
                        [each["payloads"][change]]
                        if what == "payload" and change in each["payloads"]
                        else each["masses"].get(change, [])
                    )
                    for row in own:
                        if row["starts"] == starts:
                            said.append(outcome(row, each["mass_kg"], what))
                            narrow.append(said[-1][1] <= NARROW_1 * each["mass_kg"])
                if not said:
                    continue
                count = {k: sum(one[0] == k for one in said) for k in ("held", "refused", "warned")}
                half = [one[1] for one in said if np.isfinite(one[1])]
                rows.append(
                    [
                        *(what, change, str(starts), str(len(said))),
                        *(str(each) for each in count.values()),
                        str(len(said) - sum(count.values())),
                        f"{np.median(half):.1f}" if half else "–",
                        f"{np.mean(narrow):.0%}",
                    ]
                )
    head = ["of", "since", "starts", "logs", "held", "refused", "warned", "wrong", "± kg", "narrow"]
    return markdown(head, rows)


def main(
    campaigns: int = 60, first: int = 0, kept: Annotated[Path | None, typer.Option("--json")] = None
) -> None:
    lines = kept.read_text().splitlines() if kept and kept.exists() else []
    found = {each["seed"]: each for each in map(json.loads, lines)}
    for seed in range(first, first + campaigns):
        if seed not in found:
            found[seed] = campaign(seed)
            if kept is not None:
                with kept.open("a", encoding="utf-8") as out:
                    out.write(json.dumps(found[seed]) + "\n")
            print(seed, {k: found[seed].get(k) for k in ("no_line", "U_kg", "mass_kg")}, flush=True)
    print(table(list(found.values())))


if __name__ == "__main__":
    typer.run(main)
