"""Bayesian choice of effects: drifts, position-dependent force, gears and uneven ground.

A drifting gain and friction that changes as the oil warms look alike at a steady speed, and if both
are free to cancel each other, they hide a change of load. That a log has neither is more probable
than that it has two which cancel: the evidence of each choice says by how much (Bayesian model
averaging, Hoeting et al. 1999). The effects that the most probable choice excludes remain in the
uncertainty.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from typing import Final, Self

import numpy as np

from analysis.model.prior_settings import PriorSettings
from analysis.weighing.force_by_position import BY_PLACE, PLACE
from analysis.weighing.friction_warming import WARMING
from analysis.weighing.low_gears import BY_GEAR, LOW_GEARS
from analysis.weighing.motion_samples import Floats
from analysis.weighing.nuisances import Nuisance
from analysis.weighing.uneven_ground import GROUND
from analysis.weighing.weighing_limits import LIMITS
from estimators.joint.posterior_fit import PosteriorFit

#: Settings with the prior standard deviations of each effect's terms.
_WIDTHS: Final = {
    "friction": ("viscous_drift_share",),
    "gain": ("gain_drift",),
    BY_PLACE: ("place_share",),
    BY_GEAR: ("low_gear_share",),
    "ground": ("ground_share", "ground_change_share", "ground_route_share"),
}
#: Effect that each term belongs to.
EFFECTS: Final = {
    **dict.fromkeys(WARMING, "friction"),
    "gain_drift": "gain",
    **{term.name: BY_PLACE for term in PLACE},
    **{term.name: BY_GEAR for term in LOW_GEARS},
    **{term.name: "ground" for term in GROUND},
}
_LOG_ODDS: Final = float(
    np.log(LIMITS.effect_prior_probability / (1.0 - LIMITS.effect_prior_probability))
)


@dataclass(frozen=True)
class MostProbableEffects:
    """The most probable choice of effects, and the changes by the other choices.

    Attributes:
        left_out: effects that the most probable choice excludes.
        probability: (choices,) probabilities of the other choices.
        mass_change_by_choice_kg: (choices, masses) change of the masses by each other choice.
        response_kg: (masses, terms) response of the masses to one unit of each term.
        added_covariance_by_choice: (choices, terms, terms) covariance of the terms by each other
            choice minus that by the most probable one.
        mass_change_without_effect_kg: (masses,) change of the masses without each included effect,
            by effect.
    """

    left_out: tuple[str, ...]
    probability: Floats
    mass_change_by_choice_kg: Floats
    response_kg: Floats
    added_covariance_by_choice: Floats
    mass_change_without_effect_kg: Mapping[str, Floats]

    @classmethod
    def from_fit(
        cls, fit: PosteriorFit, mass_count: int, terms: tuple[Nuisance, ...], prior_std: Floats
    ) -> Self | None:
        """Compute the probabilities of all choices of effects; None without effects.

        Args:
            fit: fit of masses, friction and terms.
            mass_count: number of masses.
            terms: the nuisances.
            prior_std: (terms,) prior standard deviations; the prior means are 0.
        """
        own = [place for place, term in enumerate(terms) if term.name in EFFECTS]
        if not own or not np.isfinite(fit.covariance).all():
            return None
        at, variance = mass_count + 1 + np.array(own), prior_std[own] ** 2
        found, covariance = fit.theta[at], fit.covariance[np.ix_(at, at)]
        precision = np.linalg.inv(covariance)
        squares, vectors = np.linalg.eigh(precision - np.diag(1.0 / variance))
        information = (vectors * np.maximum(squares, 0.0)) @ vectors.T
        effect = [EFFECTS[terms[place].name] for place in own]
        names = sorted(set(effect))
        combinations = list(product((False, True), repeat=len(names)))
        choices = [
            score_effect_choice(
                np.array([kept[names.index(name)] for name in effect]),
                sum(kept) * _LOG_ODDS,
                information,
                precision @ found,
                variance,
            )
            for kept in combinations
        ]
        evidence = np.array([choice[0] for choice in choices])
        probability = np.exp(evidence - evidence.max())
        probability /= probability.sum()
        best = int(np.argmax(probability))
        response = fit.covariance[:mass_count, at] @ precision
        _, kept, mean, spread = choices[best]
        others = [choice for number, choice in enumerate(choices) if number != best]
        removed_kg = {
            name: response @ (choices[combinations.index(fewer)][2] - mean)
            for place, name in enumerate(names)
            if (fewer := _drop_effect_from_choice(combinations[best], place)) != combinations[best]
        }
        return cls(
            tuple(sorted({name for name, has in zip(effect, kept, strict=True) if not has})),
            np.delete(probability, best),
            np.stack([response @ (other[2] - mean) for other in others]),
            response,
            np.stack([other[3] - spread for other in others]),
            removed_kg,
        )

    def copy_priors_excluding_unlikely_effects(self, priors: PriorSettings) -> PriorSettings:
        """Priors whose standard deviations are almost 0 for the excluded effects."""
        keys = [key for name in self.left_out for key in _WIDTHS[name]]
        return priors.model_copy(
            update={key: LIMITS.left_out_prior_ratio * getattr(priors, key) for key in keys}
        )

    def compute_mass_sum_u_by_effect_choice_kg(self, coefficients: Floats) -> float:
        """Uncertainty of a sum of masses due to the choice, in kg (law of total variance).

        Args:
            coefficients: (masses,) weight of each mass.
        """
        moved, by_term = (
            self.mass_change_by_choice_kg @ coefficients,
            coefficients @ self.response_kg,
        )
        wider = np.einsum("i,cij,j->c", by_term, self.added_covariance_by_choice, by_term)
        return float(np.sqrt(self.probability @ (moved**2 + np.maximum(wider, 0.0))))


def _drop_effect_from_choice(
    chosen_effects: tuple[bool, ...], effect_index: int
) -> tuple[bool, ...]:
    """The same choice of effects without one effect."""
    return (*chosen_effects[:effect_index], False, *chosen_effects[effect_index + 1 :])


def _invert_precision(precision: Floats) -> Floats:
    """Covariance from a precision matrix; pseudoinverse if rounding makes it singular."""
    try:
        inverse = np.linalg.inv(precision)
    except np.linalg.LinAlgError:
        inverse = np.linalg.pinv(precision, hermitian=True)
    return inverse.astype(np.float64, copy=False)


def score_effect_choice(
    chosen_effects: np.ndarray,
    log_prior_odds: float,
    information: Floats,
    scores: Floats,
    variance: Floats,
) -> tuple[float, np.ndarray, Floats, Floats]:
    """Log evidence of a choice of effects, the choice, and mean and covariance of its terms.

    Args:
        chosen_effects: (terms,) whether the choice includes each term.
        log_prior_odds: log prior odds of the choice, up to a constant.
        information: (terms, terms) information of the log.
        scores: (terms,) information times the estimates.
        variance: (terms,) prior variances.
    """
    mean, covariance = (
        np.zeros(chosen_effects.size),
        np.zeros((chosen_effects.size, chosen_effects.size)),
    )
    own = np.flatnonzero(chosen_effects)
    if not own.size:
        return log_prior_odds, chosen_effects, mean, covariance
    inside = np.ix_(own, own)
    inner = _invert_precision(information[inside] + np.diag(1.0 / variance[own]))
    mean[own], covariance[inside] = inner @ scores[own], inner
    sized = np.linalg.slogdet(np.eye(own.size) + variance[own][:, None] * information[inside])[1]
    # at least 0 except for rounding, which matters only if the matrix is singular
    sized = max(sized, 0.0)
    return (
        float(log_prior_odds - sized / 2.0 + scores[own] @ mean[own] / 2.0),
        chosen_effects,
        mean,
        covariance,
    )
