"""Campaigns as whole logs: does the calibrated mass of a later log hold its interval?

A machine's constants are drawn once a campaign, what differs from log to log once a log. Six loads,
a log of nine starts each, all of one day; then three logs with loads in between.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import polars as pl
from scipy.optimize import brentq
from scipy.stats import norm
from scipy.stats import t as student_t

from analysis.calibration.campaign.campaign_plan import CampaignRun
from analysis.calibration.campaign.campaign_readings import (
    make_readings_of_campaign_runs,
    make_run_changes_per_learnt_mean_u,
)
from analysis.calibration.line.calibration import CalibrationOptions
from analysis.calibration.line.line_fit import fit_calibration_line
from analysis.calibration.use.apply_calibration import calibrate_loads, collect_later_log_facts
from analysis.calibration.use.learnt_priors import (
    copy_machine_with_learnt_priors,
    list_learnable_term_estimates,
    pool_learnt_terms_over_logs,
)
from analysis.model.machine import Machine
from analysis.model.run_record import Run
from analysis.simulation import Scenario, SimulatedLog, simulate_campaign
from replay.inputs.derived_logs import MemoryLog, copy_machine_with_simulated_channels
from replay.machines.machine_file import load_machine
from replay.pipeline import run

LOADS_KG: Final = (0.0, 50.0, 100.0, 150.0, 200.0, 250.0)
LATER_KG: Final = (30.0, 120.0, 220.0)
EMPTY_KG: Final = 3614.0
#: Standard deviations of the reference masses, and of what differs from log to log, in N.
REFERENCE_U_KG: Final = 0.5
FROM_LOG_TO_LOG_N: Final = 15.0
DAY: Final = "2023-11-14"
CONFIDENCE: Final = 0.95
#: Between these the degrees of freedom of an interval are looked for.
FREEDOMS: Final = (0.5, 1e6)


@dataclass(frozen=True)
class Outcome:
    """A later load: calibrated less true mass, its interval's half width, u, and whether it held.

    NaN where the mass was refused.
    """

    error_kg: float
    half_kg: float
    u_kg: float
    held: bool

    @property
    def score(self) -> float:
        """The error in deviations of a normal distribution, by the interval's Student's t."""
        factor = self.half_kg / self.u_kg
        tail = 0.5 + CONFIDENCE / 2.0
        if factor <= norm.ppf(tail):
            return self.error_kg / self.u_kg
        degrees_of_freedom = brentq(lambda at: float(student_t.ppf(tail, at)) - factor, *FREEDOMS)
        beyond = student_t.sf(abs(self.error_kg) / self.u_kg, degrees_of_freedom)
        return float(np.copysign(norm.isf(beyond), self.error_kg))


def machine_of(dice: np.random.Generator) -> dict[str, dict[str, float]]:
    """Constants of a machine: gain and offset of the force, delays, wheels, accelerometer."""
    return {
        "sensors": {
            "force_gain": float(np.exp(dice.normal(0.0, 0.03))),
            "force_bias_N": dice.normal(0.0, 60.0),
            "force_delay_s": dice.uniform(0.0, 0.01),
            "speed_delay_s": dice.uniform(0.0, 0.01),
            "acc_bias_m_s2": dice.normal(0.0, 0.02),
            "force_drift_N": dice.uniform(0.0, 20.0),
        },
        "machine": {"wheel_radius_excess": dice.normal(0.0, 0.003)},
    }


def log_of(
    constants: dict[str, dict[str, float]], load_kg: float, seed: int, dice: np.random.Generator
) -> SimulatedLog:
    """A log of nine starts of one load."""
    default = Scenario()
    sensors = dict(constants["sensors"])
    sensors["force_bias_N"] += dice.normal(0.0, FROM_LOG_TO_LOG_N)
    scenario = default.model_copy(
        update={
            "machine": default.machine.model_copy(update=constants["machine"]),
            "sensors": default.sensors.model_copy(update={**sensors, "seed": seed}),
            "campaign": default.campaign.model_copy(update={"loads_kg": (load_kg,)}),
        }
    )
    (made,) = simulate_campaign(scenario)
    return made


def replays(logs: Sequence[SimulatedLog], machine: Machine) -> list[Run]:
    return [run(MemoryLog(log), copy_machine_with_simulated_channels(machine, log)) for log in logs]


def run_of(load_kg: float) -> CampaignRun:
    """The run of a load."""
    name = f"{load_kg:g}"
    return CampaignRun.model_validate({"id": f"kg-{name}", "log": name, "loads": (), "day": DAY})


def readings_of(replayed: Run, load_kg: float) -> pl.DataFrame:
    """Frame `readings` of a log."""
    found = make_readings_of_campaign_runs(replayed, [run_of(load_kg)], "joint_mass")
    return found.with_columns(load_id=pl.lit(f"{load_kg:g}"))


def campaign(seed: int, machine: Machine) -> dict[str, list[Outcome]]:
    """The later loads of one campaign, by priors that were learnt and by those of the file."""
    dice = np.random.default_rng([seed, 1713])
    constants = machine_of(dice)
    loads_kg = (*LOADS_KG, *LATER_KG)
    logs = [
        log_of(constants, load_kg, 100_000 + 100 * seed + number, dice)
        for number, load_kg in enumerate(loads_kg)
    ]
    stated = EMPTY_KG + np.array(LOADS_KG) + dice.normal(0.0, REFERENCE_U_KG, len(LOADS_KG))
    references = pl.DataFrame(
        {"load_id": [f"{load_kg:g}" for load_kg in LOADS_KG], "reference_kg": stated}
    )
    raw = replays(logs, machine)
    said = [
        term
        for load_kg, each in zip(LOADS_KG, raw, strict=False)
        for term in list_learnable_term_estimates(f"{load_kg:g}", each.frames["nuisances"])
    ]
    narrow = replays(
        logs, copy_machine_with_learnt_priors(machine, pool_learnt_terms_over_logs(said))
    )
    return {
        name: _outcomes(replayed, references)
        for name, replayed in (("learnt from its logs", narrow), ("of the machine file", raw))
    }


def _outcomes(replayed: list[Run], references: pl.DataFrame) -> list[Outcome]:
    """Fit the first logs, and weigh the others."""
    first, later = replayed[: len(LOADS_KG)], replayed[len(LOADS_KG) :]
    table = pl.concat([readings_of(*each) for each in zip(first, LOADS_KG, strict=True)])
    covariance = np.eye(len(LOADS_KG)) * REFERENCE_U_KG**2
    responses = [
        one
        for each, load_kg in zip(first, LOADS_KG, strict=True)
        for one in make_run_changes_per_learnt_mean_u(each, [run_of(load_kg)], "joint_mass")
    ]
    options = CalibrationOptions("joint_mass")
    line = fit_calibration_line(table, references, covariance, options, responses)
    body = load_machine("cat262c.toml").machine
    found: list[Outcome] = []
    for each, load_kg in zip(later, LATER_KG, strict=True):
        log = collect_later_log_facts(each.frames, body)
        row = calibrate_loads(each.frames["loads"], line, log).row(0, named=True)
        true_kg = EMPTY_KG + load_kg
        if row["calibrated_kg"] is None:
            print(f"refused: {row['calibrated_reason']}", flush=True)
            found.append(Outcome(np.nan, np.nan, np.nan, held=False))
            continue
        low, high = row["calibrated_low_kg"], row["calibrated_high_kg"]
        error_kg = row["calibrated_kg"] - true_kg
        held = low <= true_kg <= high
        found.append(Outcome(error_kg, (high - low) / 2.0, row["calibrated_u_kg"], held))
    return found


def whole(campaigns: int, seed: int) -> Iterator[list[str]]:
    """A row by priors, as `summed_up` gives them."""
    machine = load_machine("cat262c.toml")
    found: dict[str, list[list[Outcome]]] = {}
    for number in range(campaigns):
        for name, outcomes in campaign(seed * 1000 + number, machine).items():
            found.setdefault(name, []).append(outcomes)
        print(number, {name: _held(each[-1]) for name, each in found.items()}, flush=True)
    return summed_up(found)


def summed_up(found: dict[str, list[list[Outcome]]]) -> Iterator[list[str]]:
    """A row by priors: masses, held, half interval, r.m.s. error, error over u, score, refused.

    A score is the error in deviations of a normal distribution, by the Student's t that its
    interval is of: r.m.s. 1 where intervals are as wide as they should be.

    Args:
        found: by priors, the later loads of each campaign.
    """
    for name, campaigns in found.items():
        every = [one for outcomes in campaigns for one in outcomes]
        known = [one for one in every if np.isfinite(one.error_kg)]
        errors = np.array([one.error_kg for one in known])
        over = errors / np.array([one.u_kg for one in known])
        # masses of one campaign share its line: the campaigns are what is independent
        squares = [
            float(np.mean([one.score**2 for one in outcomes if np.isfinite(one.error_kg)]))
            for outcomes in campaigns
            if any(np.isfinite(one.error_kg) for one in outcomes)
        ]
        score = float(np.sqrt(np.mean(squares)))
        score_u = float(np.std(squares, ddof=1)) / np.sqrt(len(squares)) / (2.0 * score)
        yield [
            name,
            str(len(known)),
            f"{100.0 * np.mean([one.held for one in known]):.1f} %",
            f"{np.median([one.half_kg for one in known]):.1f}",
            f"{np.sqrt((errors**2).mean()):.1f}",
            f"{np.sqrt((over**2).mean()):.2f}",
            f"{score:.2f} ± {score_u:.2f}",
            str(len(every) - len(known)),
        ]


def _held(outcomes: Sequence[Outcome]) -> str:
    return f"{sum(one.held for one in outcomes)}/{len(outcomes)}"
