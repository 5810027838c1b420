"""As found: what the machine's line before this one makes of the campaign's points."""

import math

import polars as pl

from recordings.calibration.evidence_document import AsFound, Estimator, EvidenceDocument


def check_earlier_line(
    before: EvidenceDocument | None,
    of_before: Estimator | None,
    estimator: Estimator,
    points: pl.DataFrame,
) -> AsFound | None:
    """The line before, and its errors on these points; None where there is no line.

    Args:
        before: the evidence before.
        of_before: its estimator; earlier formats digest it otherwise.
        estimator: of this campaign; a line of another one says nothing of its points.
        points: of this campaign, a row a run.
    """
    if before is None or before.calibration is None:
        return None
    line = before.calibration
    found = AsFound(
        evidence_id=before.id, alpha_1=line.alpha_1, beta_kg=line.beta_kg, rms_error_kg=None
    )
    if of_before != estimator:
        return found
    return found.model_copy(update={"rms_error_kg": rms_error_kg(found, points)})


def rms_error_kg(line: AsFound, points: pl.DataFrame) -> float | None:
    """Root mean square of calibrated less reference mass of the points by this line."""
    errors = [
        line.alpha_1 * row["mean_kg"] + line.beta_kg - row["reference_kg"]
        for row in points.drop_nulls("mean_kg").iter_rows(named=True)
    ]
    return math.sqrt(sum(e * e for e in errors) / len(errors)) if errors else None
