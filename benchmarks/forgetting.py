"""Which λ the recursive estimator should forget with, measured.

    python -P benchmarks/forgetting.py [--seeds 20] [--write]

Three campaigns, each over all seeds: the paper's six loads × nine starts after (19); a change from
0 to 250 kg; one start followed by 90 s of cruise, gated and not. `--write` puts the table into
docs/decisions/0011-forgetting.md.
"""

import numpy as np
import polars as pl
import typer

from analysis.calibration.campaign.by_method import fit_calibration_line_by_method
from analysis.calibration.campaign.campaign_readings import average_masses_by_method_and_run
from analysis.calibration.campaign.method_errors import compute_rms_mass_errors_by_method
from analysis.model.axes import make_straight_regressor_and_force
from analysis.model.run_record import Run
from analysis.simulation import Scenario, simulate_campaign
from analysis.stages.estimation.method_estimates import trace_estimates
from analysis.stages.gating.gate import gate_windows
from benchmarks.page import markdown, put
from benchmarks.simulated import excitation, joined, scenario
from estimators.methods import rls
from replay import load_machine

LAMBDAS = (0.99, 0.995, 0.997, 0.998, 0.999, 0.9995, 1.0)
OPTIONS = [
    *((value, False) for value in LAMBDAS),
    *((value, True) for value in LAMBDAS if value < 1.0),
]
MACHINE = load_machine("cat262c.toml", ['settings.trace.methods=["rls"]'])
Found = dict[tuple[float, bool], list[float]]


def estimates_of(replayed: Run, runs: pl.DataFrame) -> dict[tuple[float, bool], pl.DataFrame]:
    """What each run's last state says, by λ and kind of forgetting."""
    frame = replayed.frames["excitation"]
    gated = gate_windows(frame, MACHINE.settings)
    found: dict[tuple[float, bool], pl.DataFrame] = {}
    for forgetting, directional in OPTIONS:
        change = {"trace.forgetting": forgetting, "trace.directional_forgetting": directional}
        traced = trace_estimates(frame, gated, MACHINE.settings.copy_with_changes(change))
        whole = Run({"estimates/rls": traced["rls"]}, replayed.provenance)
        found[forgetting, directional] = average_masses_by_method_and_run(whole, runs)
    return found


def campaign(seeds: int) -> tuple[Found, Found]:
    """Left-out error of the calibrated load means, and raw error of one start."""
    left_out: Found = {option: [] for option in OPTIONS}
    raw: Found = {option: [] for option in OPTIONS}
    for seed in range(1, seeds + 1):
        plan = scenario(seed, loads_kg=Scenario().campaign.loads_kg)
        for option, table in estimates_of(*joined(plan, machine=MACHINE)).items():
            left_out[option].append(
                compute_rms_mass_errors_by_method(fit_calibration_line_by_method(table))[
                    "rmse_left_out_kg"
                ][0]
            )
            raw[option] += (table["mass_kg"] - table["reference_kg"]).to_list()
    return left_out, raw


def load_change(seeds: int) -> tuple[Found, Found]:
    """What is left of a change of 250 kg after one start and after three, in kg."""
    one: Found = {option: [] for option in OPTIONS}
    three: Found = {option: [] for option in OPTIONS}
    for seed in range(1, seeds + 1):
        runs = 12
        plan = scenario(seed, loads_kg=(0.0, 250.0), runs=runs)
        for option, table in estimates_of(*joined(plan, machine=MACHINE)).items():
            error = (table["mass_kg"] - table["reference_kg"]).to_numpy()
            # less the bias that it has without a change as well
            settled = error[runs - 3 : runs].mean()
            one[option].append(error[runs] - settled)
            three[option].append(error[runs + 2] - settled)
    return one, three


def cruise(seeds: int) -> tuple[Found, Found]:
    """Error after a start and 90 s of cruise: of every window until braking, and of the gated."""
    ungated: Found = {option: [] for option in OPTIONS}
    gated: Found = {option: [] for option in OPTIONS}
    window = MACHINE.settings.gate.window_samples
    for seed in range(1, seeds + 1):
        plan = scenario(seed, runs=1, cruise_s=90.0)
        log = next(iter(simulate_campaign(plan)))
        frame = excitation(log, MACHINE)
        A, f = make_straight_regressor_and_force(frame, MACHINE.settings)
        # until the brakes act: 0.1 s before, the mean looks back only
        driven = frame["t_ns"].to_numpy() < log.trials["braking_ns"][0] - log.trials["start_ns"][0]
        complete = np.arange(f.size) >= window - 1 + np.argmax(np.isfinite(A).all(axis=1))
        chosen = gate_windows(frame, MACHINE.settings)["accepted_x"].to_numpy()
        for option in OPTIONS:
            for values, used in ((ungated, complete), (gated, chosen)):
                traced = rls.estimate_along_log(
                    A, f, window, used & driven, rls.RlsOptions(*option)
                )
                values[option].append(traced.theta[-1, 0] - 3614.0)
    return ungated, gated


def rms(values: list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def main(seeds: int = 20, write: bool = False) -> None:
    left_out, raw = campaign(seeds)
    one, three = load_change(seeds)
    ungated, gated = cruise(seeds)
    rows = [
        [
            f"{option[0]:g}{', directional' if option[1] else ''}",
            f"{np.mean(left_out[option]):.1f} ± {np.std(left_out[option]) / np.sqrt(seeds):.1f}",
            f"{rms(raw[option]):.1f}",
            f"{np.mean(one[option]):.0f}",
            f"{np.mean(three[option]):.0f}",
            f"{rms(gated[option]):.1f}",
            f"{rms(ungated[option]):,.1f}",
            f"{rms(ungated[option]) / rms(gated[option]):,.1f}",
        ]
        for option in OPTIONS
    ]
    head = [
        "λ",
        "left out after (19), kg",
        "one start, raw, kg",
        "left of +250 kg after 1 start",
        "after 3 starts",
        "after 90 s of cruise, gated, kg",
        "ungated, kg",
        "ungated over gated",
    ]
    table = markdown(head, rows)
    print(table)
    if write:
        put("decisions/0011-forgetting.md", "make forgetting", table)


if __name__ == "__main__":
    typer.run(main)
