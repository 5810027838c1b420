"""What each run of a campaign says by each method for the calibration (19)."""

import polars as pl

from analysis.model.methods import METHODS, LogSummary
from analysis.model.run_record import Run


def run_estimates(replayed: Run, runs: pl.DataFrame) -> pl.DataFrame:
    """One mass a method and run, null where nothing in the run was accepted.

    Windowed methods give the mean of the windows that end in the run, weighted by 1/std²; the
    recursive one its last state in it; `pooled` the run's own fit.

    Args:
        replayed: a replay of the campaign's logs.
        runs: a row a run: `start_ns`, `end_ns` (unix), `load_kg`, `mass_kg` (the reference).

    Returns:
        A row a method and run: method, run, load_kg, reference_kg, mass_kg.
    """
    t0 = replayed.provenance.t0_unix_ns
    rows: list[dict[str, object]] = []
    for name, frame in replayed.frames.items():
        stage, _, method = name.partition("/")
        if stage != "estimates":
            continue
        known = frame.drop_nulls(["mass_kg", "mass_std_kg"]).with_columns(
            unix_ns=pl.col("t_ns") + t0
        )
        for number, run in enumerate(runs.iter_rows(named=True)):
            inside = known.filter(pl.col("unix_ns").is_between(run["start_ns"], run["end_ns"]))
            weight = 1.0 / pl.col("mass_std_kg") ** 2
            mass = (
                pl.col("mass_kg").last()
                if METHODS[method].summary is LogSummary.LAST
                else (pl.col("mass_kg") * weight).sum() / weight.sum()
            )
            rows.append(
                {
                    "method": method,
                    "run": number,
                    "load_kg": run["load_kg"],
                    "reference_kg": run["mass_kg"],
                    "mass_kg": inside.select(mass).item() if inside.height else None,
                }
            )
    return pl.DataFrame(
        rows,
        schema={
            "method": pl.String,
            "run": pl.Int64,
            "load_kg": pl.Float64,
            "reference_kg": pl.Float64,
            "mass_kg": pl.Float64,
        },
    )
