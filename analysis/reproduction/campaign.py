"""One simulated campaign held against its truth: what the calibrated masses of its runs are worth.

Tables 3 and 4 leave open whether an error is that of a single run or of a load's mean, and whether
a load is in the fit of (19) that corrects it; all four are given.
"""

from dataclasses import dataclass, replace

import numpy as np
import polars as pl

from analysis.calibration.straight_line import calibrate, rms_errors, run_errors
from analysis.calibration.trials import run_estimates
from analysis.gate import gate, samples_of
from analysis.reproduction.bounds import equation_noise, mass_bounds_kg
from analysis.run import Run
from analysis.settings import Settings
from analysis.simulation import Scenario
from analysis.trace import trace

#: The four errors, r.m.s. in kg over all runs, or over the loads' means.
ERRORS = ("run_kg", "run_left_out_kg", "mean_kg", "mean_left_out_kg")


@dataclass(frozen=True, eq=False)
class Campaign:
    """A simulated campaign, replayed.

    Attributes:
        scenario: what was simulated.
        replayed: the replay of its logs in one time line.
        runs: the truth of every run (`SimulatedLog.runs`).
        noise_free: the true motion (`SimulatedLog.noise_free`), all logs in one.
    """

    scenario: Scenario
    replayed: Run
    runs: pl.DataFrame
    noise_free: pl.DataFrame

    @property
    def settings(self) -> Settings:
        """The settings of the replay."""
        return self.replayed.provenance.settings

    def estimates(self) -> pl.DataFrame:
        """One mass a method and run."""
        return run_estimates(self.replayed, self.runs)


def judged_anew(campaign: Campaign, settings: Settings) -> Campaign:
    """The same campaign with another gate or other estimators; nothing before the gate changes."""
    excitation = campaign.replayed.frames["excitation"]
    return accepting(campaign, gate(excitation, settings), settings)


def accepting(campaign: Campaign, gated: pl.DataFrame, settings: Settings) -> Campaign:
    """The same campaign with the windows that `gated` accepts."""
    frames = campaign.replayed.frames
    estimates = trace(frames["excitation"], gated, settings)
    about = campaign.replayed.provenance
    replayed = Run(
        {
            "excitation": frames["excitation"],
            "gate": gated,
            **{f"estimates/{method}": frame for method, frame in estimates.items()},
        },
        about.model_copy(update={"settings": settings}),
    )
    return replace(campaign, replayed=replayed)


def errors(campaign: Campaign) -> pl.DataFrame:
    """How wrong the calibrated masses are.

    Returns:
        A row a method: `method`, `runs` (that gave a mass), and in kg, r.m.s., `run_kg` and
        `run_left_out_kg` over single runs, `mean_kg` and `mean_left_out_kg` over load means.
    """
    estimates = campaign.estimates()
    single = run_errors(estimates).group_by("method", maintain_order=True).agg(
        pl.col("mass_kg").count().alias("runs"),
        (pl.col("error_kg") ** 2).mean().sqrt().alias("run_kg"),
        (pl.col("error_left_out_kg") ** 2).mean().sqrt().alias("run_left_out_kg"),
    )  # fmt: skip
    means = rms_errors(calibrate(estimates)).select(
        "method", mean_kg="rmse_kg", mean_left_out_kg="rmse_left_out_kg"
    )
    return single.join(means, "method", "left", maintain_order="left")


def run_bound_kg(campaign: Campaign) -> float:
    """The Cramér–Rao bound of one run's mass, r.m.s. over the runs that have an accepted window.

    From all samples in accepted windows of the run, but those that truly brake: their force is not
    what (7) says.
    """
    frames, scenario = campaign.replayed.frames, campaign.scenario
    window = campaign.settings.gate.window_samples
    used = samples_of(frames["gate"]["accepted_x"].to_numpy(), window)
    unix_ns = frames["excitation"]["t_ns"] + campaign.replayed.provenance.t0_unix_ns
    a, v = pl.col("acc_x_m_s2"), pl.col("speed_x_m_s")
    motion = (
        pl.DataFrame({"time_ns": unix_ns})
        .filter(used)
        .sort("time_ns")
        .join_asof(campaign.noise_free.sort("time_ns"), on="time_ns")
        .join_asof(campaign.runs.sort("start_ns"), left_on="time_ns", right_on="start_ns")
        .filter((pl.col("time_ns") < pl.col("end_ns")) & (pl.col("phase") != "braking"))
        .group_by("load_kg", "run", "mass_kg", "friction_N_s_m")
        .agg(aa=(a * a).sum(), av=(a * v).sum(), vv=(v * v).sum())
    )
    noise_N = [
        equation_noise(scenario.sensors, row["mass_kg"], row["friction_N_s_m"])
        for row in motion.iter_rows(named=True)
    ]
    sums = (motion[name].to_numpy() for name in ("aa", "av", "vv"))
    bounds_kg = np.array(noise_N) * mass_bounds_kg(1.0, *sums)
    return float(np.sqrt((bounds_kg**2).mean())) if bounds_kg.size else float("nan")
