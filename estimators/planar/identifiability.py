"""Identifiability: the parameters, or combinations of parameters, that a motion determines.

A motion's stacked regressor A = U S Vᵀ determines the part of φ in the span of the right singular
vectors V_r whose singular values are not zero. Parameter i is determined if (V_r V_rᵀ)_ii = 1. The
reduced row echelon form C of V_rᵀ has the same span and is easier to read: A φ = A_base (C φ),
where A_base contains only the columns of the pivots. A row of C with one entry is a parameter; the
other rows are combinations (the base parameters of Gautier and Khalil, 1990).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimators.arrays import Bools, Floats, Ints
from estimators.errors import DataError
from estimators.planar.planar_fit_limits import LIMITS


@dataclass(frozen=True, slots=True)
class Identifiability:
    """Parameters, or combinations of p parameters, that a motion determines.

    Attributes:
        parameters: (p,) names of the parameters.
        rank: number of parameters and combinations that the motion determines.
        identifiable: (p,) whether each parameter is determined by itself.
        base: (rank,) sufficient columns: pivots of `echelon`.
        echelon: (rank, p) determined combinations, with coefficient 1 at their pivot in `base`.
        condition: condition number of the base columns, scaled to unit norm.
    """

    parameters: tuple[str, ...]
    rank: int
    identifiable: Bools
    base: Ints
    echelon: Floats
    condition: float

    @property
    def determined_combinations(self) -> Floats:
        """Combinations of parameters that are determined although the single parameters are not.

        (rank - identifiable, p): the rows of `echelon` with several parameters.
        """
        return self.echelon[~self.identifiable[self.base]]

    def format_combinations(self) -> list[str]:
        """The combinations as text: `mass_kg - 5 first_moment_x_kg_m`."""
        return [_format_combination(row, self.parameters) for row in self.determined_combinations]


def find_identifiable_parameters(
    A: Floats, parameters: Sequence[str], noise: Floats | None = None, samples: int | None = None
) -> Identifiability:
    """Find the parameters and combinations that a motion determines.

    Args:
        A: (..., p) stacked regressor; all axes but the last are rows.
        parameters: (p,) names of the columns.
        noise: (p,) r.m.s. noise of each measured column, in its unit. Directions below
            `noise_margin` times the noise do not count and remain in the residuals; None treats A
            as exact, so that noise makes everything appear determined.
        samples: number of rows that A represents, if A holds triangular factors.

    Raises:
        DataError: A contains NaN, the numbers of names or noises differ from that of the columns,
            or the noise of a column that is not all 0 is not positive.
    """
    rows = A.reshape(int(np.prod(A.shape[:-1])), A.shape[-1])
    p = A.shape[-1]
    n = rows.shape[0] if samples is None else samples
    if len(parameters) != p:
        raise DataError(
            f"the regressor has {p} columns, but {len(parameters)} parameters are named; name one "
            "parameter per column"
        )
    if not np.isfinite(rows).all():
        raise DataError("the regressor holds NaN or infinity; exclude these samples")
    length = np.linalg.norm(rows, axis=0)
    if noise is None:
        scale = length
    elif noise.shape == (p,) and (noise[length > 0.0] > 0.0).all():
        scale = noise * np.sqrt(max(n, 1))
    else:
        raise DataError(
            f"noise must hold {p} values, above zero for every column that is not all zero; "
            f"got {noise}"
        )
    scale = np.where(length > 0.0, scale, 1.0)
    # R has A's singular values and is at most p rows high, however long the log
    R: Floats = np.asarray(np.linalg.qr(rows / scale, mode="r"))
    singular, Vt = np.linalg.svd(R)[1:]
    if noise is None:
        smallest = max(n, p) * np.finfo(float).eps * singular.max(initial=0.0)
        slack = LIMITS.exact_slack
    else:
        smallest, slack = LIMITS.noise_margin, LIMITS.noisy_slack
    rank = int((singular > smallest).sum())
    identifiable = (Vt[:rank] ** 2).sum(0) > 1.0 - slack
    base, echelon = reduce_to_row_echelon(Vt[:rank], identifiable)
    # coefficients that count as 0 by the test above
    echelon[identifiable[base]] = 0.0
    echelon[np.abs(echelon) < np.sqrt(slack / p)] = 0.0
    echelon[:, base] = np.eye(rank)
    return Identifiability(
        parameters=tuple(parameters),
        rank=rank,
        identifiable=identifiable,
        base=base,
        echelon=echelon * scale / scale[base][:, None],
        condition=compute_condition_number_of_base_columns(R, base),
    )


def reduce_to_row_echelon(rows: Floats, identifiable: Bools) -> tuple[Ints, Floats]:
    """Pivots (r,), ascending, and reduced row echelon form (r, p) of r independent rows.

    Parameters determined by themselves are pivots. Among the others the next pivot is the earliest
    sufficiently independent column rather than the largest, so that combinations contain the mass
    if possible.
    """
    rest = rows.copy()
    pivots: list[int] = []
    alone = [int(i) for i in np.flatnonzero(identifiable)]
    for number in range(rows.shape[0]):
        length = np.linalg.norm(rest, axis=0)
        preferred = int(np.argmax(length * LIMITS.pivot_preference >= length.max()))
        pivot = alone[number] if number < len(alone) else preferred
        pivots.append(pivot)
        direction = rest[:, pivot] / length[pivot]
        rest -= np.outer(direction, direction @ rest)
    base = np.array(sorted(pivots), np.int64)
    return base, np.asarray(np.linalg.solve(rows[:, base], rows), np.float64)


def compute_condition_number_of_base_columns(
    triangular_factor: Floats, base_columns: Ints
) -> float:
    """Condition number of the base columns scaled to unit norm; infinite without any."""
    if base_columns.size == 0:
        return np.inf
    columns = triangular_factor[:, base_columns]
    singular = np.linalg.svd(columns / np.linalg.norm(columns, axis=0), compute_uv=False)
    return float(singular[0] / singular[-1])


def _format_combination(row: Floats, parameters: tuple[str, ...]) -> str:
    """Text of a linear combination, with coefficients to four digits."""
    text = ""
    for i in np.flatnonzero(row):
        size = f"{abs(row[i]):.4g} ".removeprefix("1 ")
        sign = "-" if row[i] < 0.0 else "+"
        text += f" {sign} {size}{parameters[i]}"
    return text.removeprefix(" + ").strip()
