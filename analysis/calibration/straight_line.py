"""The paper's calibration (19): a straight line from estimated to reference mass, on load means."""

from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from analysis.schema import conform

#: A line through fewer loads fits them whatever they are.
_LOADS_MIN = 3
#: A spread of estimates below this share of their size is rounding, not information.
_SPREAD_MIN = 1e-9
#: What makes the runs of one point of the fit.
_POINT: Final = ("method", "load_kg", "reference_kg")


def calibrate(estimates: pl.DataFrame) -> pl.DataFrame:
    """Fit (19), m_c = alpha m + beta, for each method on the means of its loads.

    Args:
        estimates: a row a method and run: `method`, `load_kg`, `reference_kg` (machine and load)
            and `mass_kg`, null (or not finite) where the run gave none.

    Returns:
        The frame `calibration` of the schema: a row a method and load, methods in their order of
        appearance, loads ascending. A method whose estimates cover fewer than three loads, or do
        not differ from load to load, has no fit: null from `alpha_1` on. So has the error with a
        load left out where the other loads alone determine no line.

    Source:
        Equation (19), by least squares on load means: on single runs the noise of the estimates
        would flatten the line.
    """
    mass = pl.col("mass_kg").cast(pl.Float64)
    mass = pl.when(mass.is_finite()).then(mass)
    means = (
        estimates.group_by(*_POINT, maintain_order=True)
        .agg(runs=mass.count(), estimate_kg=mass.mean(), estimate_std_kg=mass.std())
        .sort("load_kg", maintain_order=True)
    )
    methods = estimates["method"].unique(maintain_order=True)
    # the empty frame in front keeps the columns where there is no method
    fits = [means.clear(), *(means.filter(pl.col("method") == method) for method in methods)]
    return conform("calibration", pl.concat(map(_fit_method, fits)))


def rms_errors(calibration: pl.DataFrame) -> pl.DataFrame:
    """Sum up a calibration: root mean square errors over its loads, a row a method.

    Args:
        calibration: the frame `calibration`.

    Returns:
        `method`, `loads` (that have an estimate), `rmse_kg` (of the fit on its own loads),
        `rmse_left_out_kg` (each load predicted by the fit on the others), `rmse_constant_kg` (what
        a prediction that ignores the estimates scores: the mean reference) and `load_range_kg`, to
        judge them by. Null where there is none.
    """
    estimated = pl.col("estimate_kg").is_not_null()
    reference = pl.col("reference_kg").filter(estimated)

    def rms(column: str) -> pl.Expr:
        return (pl.col(column) ** 2).mean().sqrt()

    return calibration.group_by("method", maintain_order=True).agg(
        loads=estimated.sum().cast(pl.Int64),
        rmse_kg=rms("error_kg"),
        rmse_left_out_kg=rms("error_left_out_kg"),
        rmse_constant_kg=reference.std(ddof=0),
        load_range_kg=reference.max() - reference.min(),
    )


def run_errors(estimates: pl.DataFrame) -> pl.DataFrame:
    """Errors of single runs after (19), fitted on load means, with and without the run's own load.

    Args:
        estimates: as `calibrate` takes them.

    Returns:
        The estimates' rows with `error_kg` and `error_left_out_kg`: the calibrated mass less the
        reference. Null where the run gave no mass, or the loads determine no line.
    """
    fitted = calibrate(estimates)
    lines = fitted.join(_lines_left_out(fitted), _POINT, "left").select(
        *_POINT, "alpha_1", "beta_kg", "alpha_left_out_1", "beta_left_out_kg"
    )
    mass, reference = pl.col("mass_kg"), pl.col("reference_kg")
    within = pl.col("alpha_1") * mass + pl.col("beta_kg")
    without = pl.col("alpha_left_out_1") * mass + pl.col("beta_left_out_kg")
    return estimates.join(lines, _POINT, "left", maintain_order="left").select(
        *estimates.columns, error_kg=within - reference, error_left_out_kg=without - reference
    )


def _lines_left_out(calibration: pl.DataFrame) -> pl.DataFrame:
    """The line of (19) without each load, a row a method and load that a line can do without."""
    rows: list[tuple[str, float, float, float, float]] = []
    fitted = calibration.filter(pl.col("error_left_out_kg").is_not_null())
    for (method,), means in fitted.group_by("method", maintain_order=True):
        estimate, reference = means["estimate_kg"].to_numpy(), means["reference_kg"].to_numpy()
        for k, load_kg in enumerate(means["load_kg"]):
            line = _line(np.delete(estimate, k), np.delete(reference, k))
            if line is not None:
                rows.append((str(method), load_kg, reference[k], *line))
    numbers = (*_POINT[1:], "alpha_left_out_1", "beta_left_out_kg")
    schema = {"method": pl.String} | dict.fromkeys(numbers, pl.Float64)
    return pl.DataFrame(rows, schema=schema, orient="row")


def _fit_method(means: pl.DataFrame) -> pl.DataFrame:
    fitted = means.filter(pl.col("estimate_kg").is_not_null())
    estimate, reference = fitted["estimate_kg"].to_numpy(), fitted["reference_kg"].to_numpy()
    line = _line(estimate, reference) if fitted.height >= _LOADS_MIN else None
    alpha, beta = line or (None, None)
    calibrated = pl.lit(alpha, pl.Float64) * pl.col("estimate_kg") + pl.lit(beta, pl.Float64)
    left_out = fitted.select(
        "load_kg",
        "reference_kg",
        error_left_out_kg=pl.Series(
            [_error_left_out(estimate, reference, k) if line else None for k in range(len(fitted))],
            dtype=pl.Float64,
        ),
    )
    return (
        means.with_columns(
            alpha_1=pl.lit(alpha, pl.Float64),
            beta_kg=pl.lit(beta, pl.Float64),
            calibrated_kg=calibrated,
        )
        .with_columns(error_kg=pl.col("calibrated_kg") - pl.col("reference_kg"))
        .join(left_out, on=["load_kg", "reference_kg"], how="left", maintain_order="left")
    )


def _line(
    estimate: NDArray[np.float64], reference: NDArray[np.float64]
) -> tuple[float, float] | None:
    """Slope and offset of least squares, or None where the estimates do not spread."""
    x0, y0 = estimate.mean(), reference.mean()
    x, y = estimate - x0, reference - y0
    if np.abs(x).max() <= _SPREAD_MIN * np.abs(estimate).max():
        return None
    alpha = float(x @ y / (x @ x))
    return alpha, float(y0 - alpha * x0)


def _error_left_out(
    estimate: NDArray[np.float64], reference: NDArray[np.float64], k: int
) -> float | None:
    """The error of load `k` under the line through the other loads."""
    line = _line(np.delete(estimate, k), np.delete(reference, k))
    if line is None:
        return None
    alpha, beta = line
    return float(alpha * estimate[k] + beta - reference[k])
