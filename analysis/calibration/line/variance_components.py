"""Variances of several random effects by restricted maximum likelihood (REML)."""

from dataclasses import dataclass

import numpy as np

from analysis.calibration.line.line_limits import LIMITS
from estimators.arrays import Floats


@dataclass(frozen=True, eq=False)
class WithinRunVariance:
    """Within-run variance of single readings: sum of squares about the run means.

    Attributes:
        squares: sum of squares, in kg².
        degrees_of_freedom: number of readings minus number of means.
    """

    squares: float
    degrees_of_freedom: int


@dataclass(frozen=True, eq=False)
class Variances:
    """Variances of the effects, with their covariance.

    Attributes:
        value: (effects,) variances.
        covariance: (effects, effects) covariance of the estimates, by the expected information.
    """

    value: Floats
    covariance: Floats

    def propagate_to_linear_combinations(self, coefficients: Floats) -> "Variances":
        """Variances of the linear combinations `coefficients` @ value."""
        return Variances(coefficients @ self.value, coefficients @ self.covariance @ coefficients.T)

    def compute_satterthwaite_degrees_of_freedom(
        self, weights: Floats, total_variance: float
    ) -> float:
        """Degrees of freedom of `total_variance`, whose estimated part is `weights` @ value.

        Source:
            Satterthwaite (1946); with the information of REML Giesbrecht and Burns (1985).
        """
        uncertain = float(weights @ self.covariance @ weights)
        return max(2.0 * total_variance**2 / uncertain, 1.0) if uncertain > 0.0 else float("inf")


def estimate_variances_by_reml(
    residual: Floats,
    design: Floats,
    effects: Floats,
    known_covariance: Floats,
    within_run: WithinRunVariance,
    initial_variances: Floats | None = None,
) -> Variances:
    """Estimate variances of random effects by Fisher scoring.

    The covariance of the observations is Σ θ_k effects_k + known. A variance that would be negative
    is set to 0, apart from rounding, and stays in the information, so that its uncertainty counts.

    Args:
        residual: (points,) observations minus any combination of the design's columns.
        design: (points, parameters) regressors that are fitted together with the variances.
        effects: (effects, points, points) covariance for a unit variance of each effect; the first
            is that of readings if `within_run.degrees_of_freedom` is not 0.
        known_covariance: (points, points) known covariance.
        within_run: scatter of the readings, for the first effect.
        initial_variances: (effects,) initial variances; None uses `guess_initial_variances`.

    Source:
        Patterson and Thompson (1971); expected information as in Searle, Casella and McCulloch,
        Variance Components, 6.6.
    """
    value = (
        guess_initial_variances(residual, design, effects, within_run)
        if initial_variances is None
        else initial_variances
    )
    floor = LIMITS.scoring_floor * max(float(value.max()), float(known_covariance.diagonal().min()))
    value = np.maximum(value, floor)
    information = np.eye(value.size)
    for _ in range(LIMITS.scoring_max_steps):
        score, information = compute_reml_score_and_information(
            residual, design, effects, known_covariance, within_run, value
        )
        stepped = take_fisher_scoring_step(value, score, information, floor)
        settled = np.abs(stepped - value).max() <= LIMITS.scoring_tolerance * max(
            stepped.sum(), 1e-300
        )
        value = stepped
        if settled:
            break
    return Variances(value, np.asarray(np.linalg.pinv(information, hermitian=True), np.float64))


def guess_initial_variances(
    residual: Floats, design: Floats, effects: Floats, within_run: WithinRunVariance
) -> Floats:
    """Initial variances (effects,): equal shares of the residual; for readings their own."""
    left = residual - design @ np.linalg.lstsq(design, residual, rcond=None)[0]
    degrees_of_freedom = max(residual.size - design.shape[1], 1)
    spread = max(float(left @ left) / degrees_of_freedom, 1e-300)
    value = np.full(len(effects), spread / len(effects))
    if within_run.degrees_of_freedom:
        value[0] = max(within_run.squares / within_run.degrees_of_freedom, 1e-300)
    return value


def compute_expected_information(
    design: Floats,
    effects: Floats,
    known_covariance: Floats,
    within_run: WithinRunVariance,
    variances: Floats,
) -> Floats:
    """(effects, effects) expected information on the variances.

    Args:
        design: as in `estimate_variances_by_reml`.
        effects: as in `estimate_variances_by_reml`.
        known_covariance: as in `estimate_variances_by_reml`.
        within_run: as in `estimate_variances_by_reml`; its sum of squares is not used.
        variances: (effects,) the variances.
    """
    return compute_fisher_information(
        compute_reml_projection(design, effects, known_covariance, variances) @ effects,
        within_run,
        variances,
    )


def compute_reml_projection(
    design: Floats, effects: Floats, known_covariance: Floats, variances: Floats
) -> Floats:
    """Projection matrix P (points, points) of restricted maximum likelihood."""
    weight = np.linalg.inv(np.tensordot(variances, effects, 1) + known_covariance)
    weighted = weight @ design
    return weight - weighted @ np.linalg.solve(design.T @ weighted, weighted.T)


def compute_fisher_information(
    projected_effects: Floats, within_run: WithinRunVariance, variances: Floats
) -> Floats:
    """Expected information (effects, effects) on the variances; readings count for the first."""
    information = 0.5 * np.einsum("kij,lji->kl", projected_effects, projected_effects)
    if within_run.degrees_of_freedom:
        information[0, 0] += 0.5 * within_run.degrees_of_freedom / variances[0] ** 2
    return information


def compute_reml_score_and_information(
    residual: Floats,
    design: Floats,
    effects: Floats,
    known_covariance: Floats,
    within_run: WithinRunVariance,
    variances: Floats,
) -> tuple[Floats, Floats]:
    """Derivative (effects,) of the restricted log likelihood, and expected information."""
    projection = compute_reml_projection(design, effects, known_covariance, variances)
    projected = projection @ residual
    through = projection @ effects
    score = 0.5 * (
        np.einsum("i,kij,j->k", projected, effects, projected) - np.trace(through, 0, 1, 2)
    )
    if within_run.degrees_of_freedom:
        score[0] += (
            0.5 * (within_run.squares / variances[0] - within_run.degrees_of_freedom) / variances[0]
        )
    return score, compute_fisher_information(through, within_run, variances)


def take_fisher_scoring_step(
    variances: Floats, score: Floats, information: Floats, min_fraction: float
) -> Floats:
    """Variances (effects,) after a scoring step, each at least `min_fraction` of its old value."""
    try:
        step = np.linalg.solve(information, score)
    except np.linalg.LinAlgError:
        step = np.linalg.lstsq(information, score, rcond=None)[0]
    return np.maximum(
        np.maximum(variances + step, LIMITS.scoring_min_shrink * variances), min_fraction
    )
