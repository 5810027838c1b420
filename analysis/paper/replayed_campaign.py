"""Simulated campaign, replayed and compared with its true values: errors of calibrated masses.

A trial is one run of a campaign (`campaign.runs`). Tables 3 and 4 do not say whether an error is
that of a single trial or of a load's mean, and whether the fit of (19) includes that load; all four
errors are given.
"""

from dataclasses import dataclass, replace

import numpy as np
import polars as pl

from analysis.calibration.campaign.by_method import fit_calibration_line_by_method
from analysis.calibration.campaign.campaign_readings import average_masses_by_method_and_run
from analysis.calibration.campaign.method_errors import (
    add_calibrated_mass_error_columns,
    compute_rms_mass_errors_by_method,
)
from analysis.model.run_record import Run
from analysis.model.settings import Settings
from analysis.paper.cramer_rao import (
    compute_cramer_rao_mass_bounds_kg,
    compute_equation_noise_std_newtons,
)
from analysis.simulation import Scenario
from analysis.stages.estimation.method_estimates import trace_estimates
from analysis.stages.gating.gate import gate_windows, mark_samples_in_accepted_windows

#: The four errors, r.m.s. in kg over all trials, or over the loads' means.
ERRORS = ("run_kg", "run_left_out_kg", "mean_kg", "mean_left_out_kg")


@dataclass(frozen=True, eq=False)
class ReplayedCampaign:
    """A simulated campaign and the replay of its logs.

    Attributes:
        scenario: simulated scenario.
        replayed: replay of its logs on one time line.
        trials: true values of every trial (`SimulatedLog.trials`).
        noise_free_motion: true motion (`SimulatedLog.noise_free_motion`) of all logs.
    """

    scenario: Scenario
    replayed: Run
    trials: pl.DataFrame
    noise_free_motion: pl.DataFrame

    @property
    def settings(self) -> Settings:
        """Settings of the replay."""
        return self.replayed.provenance.settings

    def tabulate_masses_by_method_and_trial(self) -> pl.DataFrame:
        """One mass per method and trial."""
        return average_masses_by_method_and_run(self.replayed, self.trials)


def rerun_gate_and_estimates(campaign: ReplayedCampaign, settings: Settings) -> ReplayedCampaign:
    """Rerun gate and estimators with other settings; earlier stages are unchanged."""
    excitation = campaign.replayed.frames["excitation"]
    return rerun_estimates_on_accepted_windows(
        campaign, gate_windows(excitation, settings), settings
    )


def rerun_estimates_on_accepted_windows(
    campaign: ReplayedCampaign, gated: pl.DataFrame, settings: Settings
) -> ReplayedCampaign:
    """Rerun the estimates of a campaign on the windows that `gated` accepts."""
    frames = campaign.replayed.frames
    estimates = trace_estimates(frames["excitation"], gated, settings)
    about = campaign.replayed.provenance
    replayed = Run(
        {
            "excitation": frames["excitation"],
            "gate": gated,
            **{f"estimates/{method}": frame for method, frame in estimates.items()},
        },
        about.model_copy(update={"settings": settings, "fingerprint": None}),
    )
    return replace(campaign, replayed=replayed)


def compute_calibrated_mass_errors(campaign: ReplayedCampaign) -> pl.DataFrame:
    """Errors of the calibrated masses.

    Returns:
        One row per method: `method`, `runs` (number with a mass), and r.m.s. errors in kg: `run_kg`
        and `run_left_out_kg` of single trials, `mean_kg` and `mean_left_out_kg` of load means.
    """
    estimates = campaign.tabulate_masses_by_method_and_trial()
    errors = add_calibrated_mass_error_columns(estimates)
    single = errors.group_by("method", maintain_order=True).agg(
        pl.col("mass_kg").count().alias("runs"),
        (pl.col("error_kg") ** 2).mean().sqrt().alias("run_kg"),
        (pl.col("error_left_out_kg") ** 2).mean().sqrt().alias("run_left_out_kg"),
    )  # fmt: skip
    means = compute_rms_mass_errors_by_method(fit_calibration_line_by_method(estimates)).select(
        "method", mean_kg="rmse_kg", mean_left_out_kg="rmse_left_out_kg"
    )
    return single.join(means, "method", "left", maintain_order="left")


def compute_cramer_rao_bound_of_trial_kg(campaign: ReplayedCampaign) -> float:
    """Cramér–Rao bound of a trial's mass, r.m.s. over the trials with an accepted window.

    It uses all samples in accepted windows of the trial, except those of true braking, for which
    (7) does not hold.
    """
    frames, scenario = campaign.replayed.frames, campaign.scenario
    window = campaign.settings.gate.window_samples
    used = mark_samples_in_accepted_windows(frames["gate"]["accepted_x"].to_numpy(), window)
    unix_ns = frames["excitation"]["t_ns"] + campaign.replayed.provenance.t0_unix_ns
    a, v = pl.col("acc_x_m_s2"), pl.col("speed_x_m_s")
    motion = (
        pl.DataFrame({"time_ns": unix_ns})
        .filter(used)
        .sort("time_ns")
        .join_asof(campaign.noise_free_motion.sort("time_ns"), on="time_ns")
        .join_asof(campaign.trials.sort("start_ns"), left_on="time_ns", right_on="start_ns")
        .filter((pl.col("time_ns") < pl.col("end_ns")) & (pl.col("phase") != "braking"))
        .group_by("load_kg", "run", "mass_kg", "friction_N_s_m", maintain_order=True)
        .agg(aa=(a * a).sum(), av=(a * v).sum(), vv=(v * v).sum())
    )
    noise_N = [
        compute_equation_noise_std_newtons(scenario.sensors, row["mass_kg"], row["friction_N_s_m"])
        for row in motion.iter_rows(named=True)
    ]
    sums = (motion[name].to_numpy() for name in ("aa", "av", "vv"))
    bounds_kg = np.array(noise_N) * compute_cramer_rao_mass_bounds_kg(1.0, *sums)
    return float(np.sqrt((bounds_kg**2).mean())) if bounds_kg.size else float("nan")
