"""The demo's campaign over many seeds: how good are the calibrated load means?

    python -P benchmarks/campaign.py [--seeds 20] [--coulomb 300] [--slope 1] [--set key=value]

Prints, for each method, the root mean square errors of the nine-run load means after (19), with
every load in the fit and with each left out, and the mean bias of the raw estimates.
"""

import tempfile
from pathlib import Path
from typing import Annotated

import polars as pl
import typer

from analysis.calibration.campaign.method_errors import compute_rms_mass_errors_by_method
from analysis.simulation import Scenario
from replay import load_machine
from replay.demo.run_demo import replay_simulated_campaign
from replay.simulation.simulate_logs import simulate_scenario_to_logs


def main(
    seeds: int = 20,
    coulomb: float = 0.0,
    slope: float = 0.0,
    suffix: str = ".bag",
    overrides: Annotated[list[str] | None, typer.Option("--set")] = None,
) -> None:
    base = Scenario()
    base = base.model_copy(
        update={
            "machine": base.machine.model_copy(update={"coulomb_N": coulomb}),
            "terrain": base.terrain.model_copy(update={"slope_deg": slope}),
        }
    )
    machine = load_machine("cat262c.toml", overrides or [])
    errors: list[pl.DataFrame] = []
    biases: list[pl.DataFrame] = []
    for seed in range(1, seeds + 1):
        with tempfile.TemporaryDirectory() as folder:
            logs = simulate_scenario_to_logs(
                base.copy_with_seed(seed), Path(folder) / f"campaign{suffix}"
            )
            calibration = replay_simulated_campaign(logs, machine).frames["calibration"]
        errors.append(compute_rms_mass_errors_by_method(calibration).with_columns(seed=seed))
        biases.append(
            calibration.group_by("method", maintain_order=True).agg(
                bias_kg=(pl.col("estimate_kg") - pl.col("reference_kg")).mean(),
                std_a_run_kg=pl.col("estimate_std_kg").mean(),
            )
        )
    by_method = pl.concat(errors).group_by("method", maintain_order=True)
    table = by_method.agg(
        pl.col("rmse_kg").mean().alias("in_sample_mean"),
        pl.col("rmse_kg").max().alias("in_sample_max"),
        pl.col("rmse_left_out_kg").mean().alias("left_out_mean"),
        pl.col("rmse_left_out_kg").max().alias("left_out_max"),
        pl.col("rmse_constant_kg").mean().alias("constant"),
    )
    bias = pl.concat(biases).group_by("method", maintain_order=True).mean()
    with pl.Config(tbl_rows=-1, tbl_cols=-1, tbl_width_chars=140, float_precision=2):
        print(table.join(bias, on="method", maintain_order="left"))


if __name__ == "__main__":
    typer.run(main)
