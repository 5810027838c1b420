"""Draw the four figures of a calibration report."""

from typing import Final

import numpy as np
import polars as pl

from analysis.calibration.line.calibration import Calibration
from recordings.calibration.bundle_limits import LIMITS
from recordings.calibration.evidence_document import EvidenceDocument
from recordings.report.svg_shapes import WIDTH, Axes, Drawing, shorten_text_to_width

_BOX: Final = (52.0, 22.0, WIDTH - 10.0, 196.0)


def draw_report_pictures(document: EvidenceDocument, readings: pl.DataFrame) -> list[Drawing]:
    """Draw the figures for which the evidence has data."""
    fitted, points = document.calibration, compute_reading_deviations(document, readings)
    found: list[Drawing] = []
    if fitted is not None and document.kind == "calibration":
        found += [
            _draw_calibration_line(fitted),
            _draw_calibration_residuals(fitted),
            _draw_budget_bars(fitted),
        ]
    if points.height:
        found.append(_draw_calibration_points(points))
    return found


def compute_calibrated_interval_band_kg(
    calibration: Calibration,
) -> list[tuple[float, float, float]]:
    """Compute the interval of the calibrated mass over the range of references.

    Each entry is (reference, low, high) in kg, for a run with as many readings as in the campaign.
    """
    low, high = calibration.range_kg
    readings = calibration.budget_at[1]
    found: list[tuple[float, float, float]] = []
    for mass_kg in np.linspace(low, high, LIMITS.curve_points).tolist():
        at = calibration.calibrate_estimate(
            calibration.c0_kg + calibration.c1_1 * mass_kg, None, readings
        )
        if at.low_kg is not None and at.high_kg is not None:
            found.append((mass_kg, at.low_kg, at.high_kg))
    return found


def _draw_calibration_line(calibration: Calibration) -> Drawing:
    known = [point for point in calibration.points if point.calibrated_kg is not None]
    edges = compute_calibrated_interval_band_kg(calibration)
    low, high = calibration.range_kg
    percent = f"{calibration.confidence_1:.0%}".replace("%", " %")
    picture = Drawing(
        "line",
        "Calibrated against reference mass",
        f"One point per run, {len(known)} in all, on the line of equal masses from {low:,.0f} to "
        f"{high:,.0f} kg. The band contains the calibrated mass of {percent} of later runs.",
        LIMITS.figure_height,
    )
    masses = [low, high, *(point.calibrated_kg or 0.0 for point in known)]
    axes = Axes.from_data([low, high], [*masses, *(e for _, *es in edges for e in es)], _BOX)
    axes.draw_grid_and_labels(picture, "reference in kg", "calibrated in kg")
    _draw_interval_band(picture, axes, edges)
    picture.draw_line(
        *axes.convert_to_drawing_units(low, low),
        *axes.convert_to_drawing_units(high, high),
        "ideal",
    )
    for point in known:
        tip = f"{point.run_id}: {point.calibrated_kg:,.1f} kg at {point.reference_kg:,.1f} kg"
        picture.draw_dot(
            *axes.convert_to_drawing_units(point.reference_kg, point.calibrated_kg or 0.0),
            "point",
            tip,
        )
    return picture


def _draw_calibration_residuals(calibration: Calibration) -> Drawing:
    edges = [
        (mass, low - mass, high - mass)
        for mass, low, high in compute_calibrated_interval_band_kg(calibration)
    ]
    errors = [(p, p.error_kg, "point") for p in calibration.points if p.error_kg is not None]
    left = [
        (p, p.error_left_out_kg, "left")
        for p in calibration.points
        if p.error_left_out_kg is not None
    ]
    worst = max((abs(error) for _, error, _ in [*errors, *left]), default=0.0)
    picture = Drawing(
        "residuals",
        "Errors by load: filled with the load in the fit, open without it",
        f"Calibrated less reference mass of every run; the largest is {worst:,.1f} kg. Open "
        "circles are errors of a line fitted without that load.",
        LIMITS.figure_height,
    )
    heights = [0.0, *(e for _, e, _ in [*errors, *left]), *(e for _, *es in edges for e in es)]
    axes = Axes.from_data(list(calibration.range_kg), heights, _BOX)
    axes.draw_grid_and_labels(picture, "reference in kg", "calibrated less reference in kg")
    _draw_interval_band(picture, axes, edges)
    picture.draw_line(
        *axes.convert_to_drawing_units(axes.x[0], 0.0),
        *axes.convert_to_drawing_units(axes.x[1], 0.0),
        "ideal",
    )
    for point, error_kg, look in [*left, *errors]:
        what = " with its load excluded" if look == "left" else ""
        tip = f"{point.run_id}{what}: {error_kg:+,.1f} kg"
        picture.draw_dot(*axes.convert_to_drawing_units(point.reference_kg, error_kg), look, tip)
    return picture


def _draw_budget_bars(calibration: Calibration) -> Drawing:
    rows = sorted(calibration.budget, key=lambda row: -(row.u_kg or 0.0))
    known = [row for row in rows if row.u_kg]
    largest = max((row.u_kg or 0.0 for row in known), default=1.0)
    at_kg, readings = calibration.budget_at
    picture = Drawing(
        "budget",
        "Where the uncertainty comes from",
        f"Standard uncertainties in kg of the calibrated mass of one run of {readings} readings "
        f"at {at_kg:,.0f} kg: "
        + (", ".join(f"{row.component} {row.u_kg:.2g}" for row in known) or "none is known")
        + ".",
        int(30 + LIMITS.row_height * (len(known) + 1)),
    )
    start, room = 128.0, WIDTH - 128.0 - 72.0
    for number, row in enumerate([*known, None]):
        y = 12.0 + LIMITS.row_height * number
        u_kg = calibration.u_kg if row is None else row.u_kg or 0.0
        name = "together" if row is None else row.component
        picture.draw_text(start - 6, y + 10, shorten_text_to_width(name, start - 8), "end")
        look = "left" if row is None else "bar"
        picture.fill_bar(start, y, max(room * u_kg / max(largest, calibration.u_kg), 0.5), 12, look)
        length = room * u_kg / max(largest, calibration.u_kg)
        picture.draw_text(start + length + 5, y + 10, f"{u_kg:.2g} kg", "start")
    return picture


def _draw_calibration_points(points: pl.DataFrame) -> Drawing:
    runs = points["run_id"].unique(maintain_order=True).to_list()
    used = points.filter("used")["off_kg"].to_list()
    picture = Drawing(
        "repeatability",
        "Readings about the mean of their run",
        f"{len(used)} readings of {len(runs)} runs; dashed circles were rejected. The largest of "
        f"those that count is {max(map(abs, used), default=0.0):,.1f} kg off.",
        LIMITS.figure_height,
    )
    axes = Axes.from_data([0.5, len(runs) + 0.5], [0.0, *points["off_kg"].to_list()], _BOX, 0.05)
    axes.draw_grid_and_labels(
        picture, "run, in the order of the campaign", "reading less mean in kg"
    )
    picture.draw_line(
        *axes.convert_to_drawing_units(axes.x[0], 0.0),
        *axes.convert_to_drawing_units(axes.x[1], 0.0),
        "ideal",
    )
    place = {run: number for number, run in enumerate(runs, start=1)}
    for row in points.iter_rows(named=True):
        tip = f"{row['run_id']}, reading {row['reading']}: {row['off_kg']:+,.1f} kg"
        look = "point" if row["used"] else "rejected"
        picture.draw_dot(
            *axes.convert_to_drawing_units(place[row["run_id"]], row["off_kg"]), look, tip
        )
    return picture


def _draw_interval_band(
    picture: Drawing, axes: Axes, edges: list[tuple[float, float, float]]
) -> None:
    if edges:
        lower = [axes.convert_to_drawing_units(mass, low) for mass, low, _ in edges]
        upper = [axes.convert_to_drawing_units(mass, high) for mass, _, high in edges]
        picture.fill_polygon([*lower, *reversed(upper)], "band")


def compute_reading_deviations(document: EvidenceDocument, readings: pl.DataFrame) -> pl.DataFrame:
    """Compute the deviation of each reading with a mass from the mean of its run, in kg."""
    order = {run.id: number for number, run in enumerate(document.campaign.runs)}
    mean = pl.col("mass_kg").filter("used").mean().over("run_id")
    return (
        readings.with_columns(
            off_kg=pl.col("mass_kg") - mean,
            order=pl.col("run_id").replace_strict(order, default=None),
        )
        .filter(pl.col("off_kg").is_not_null())
        .sort("order", "reading", maintain_order=True)
    )
