"""Limits of the joint fit of groups and of the partition of its units into levels."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class JointLimits:
    """Limits of the joint fit of groups and of the partition of its units into levels.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # changepoints
    #: Scatters that are tried where it is not known, over the units' own deviation.
    tried_scatters: tuple[float, ...] = (
        0.0,
        0.25,
        0.5,
        1.0,
        1.5,
        2.0,
        3.0,
        4.5,
        7.0,
        10.0,
        15.0,
        25.0,
        50.0,
    )
    #: Probabilities of a change by which candidates are made; the posterior chooses.
    candidate_probabilities: tuple[float, float, float] = (0.02, 0.2, 0.5)
    #: Distances of levels that such candidates allow, over their spread.
    candidate_windows: tuple[float, float] = (1.0, 0.1)
    #: Rounds of a partition and its effects at most.
    partition_max_rounds: int = 10
    #: Changes that are tried for removal, the smallest first.
    removable_changes: int = 20
    #: Cost of a change where none may be: it is not ruled out for good, but takes this much
    #: evidence.
    impossible_change_cost: float = 1e9

    # gain_matrix
    #: Levels from which they are eliminated one by one; dense matrices are as fast below.
    eliminated_levels: int = 64
    #: Variance of residuals that alternate, over that of white ones: they average out, but never to
    #: less.
    min_white_fraction: float = 0.1
    #: Fraction of the largest direction of the columns below which another is rounding.
    gain_rounding_fraction: float = 1e-12

    # unit_levels
    #: Rounds of residuals and their variance.
    noise_rounds: int = 3
    #: Units from which they share their effects.
    shared_effect_units: int = 5
    #: Smallest fraction of a unit's sum of squares that is no noise.
    min_own_fraction: float = 0.1

    # partition_posterior
    #: Probability that what tells a change (a boom that moves) has nothing to do with it in a
    #: series,
    unrelated_hint_probability: float = 0.25
    #: and that what is taken for a filling has not.
    unrelated_filling_probability: float = 0.05
    #: Probability that two records in turn have one level, where records mostly have one each. With
    #: 0 two of seven that have one cost 120 to 1, and one family of files in five had a level too
    #: many.
    same_level_probability: float = 0.1
    #: Probability that the load is the same on both sides of where a stretch is named as empty.
    misnamed_probability: float = 0.02
    #: Probability that one filling among others changes no level: a change too many costs little,
    #: one too few bends what all units share,
    unfilled_probability: float = 0.0003
    #: that what is filled is not emptied once before it is filled again,
    unusual_emptying_probability: float = 0.05
    #: known as well as so many cycles would tell it: where a driver mostly dumps in two parts,
    #: seven cycles pay for that as two or three would at a known probability,
    usual_emptying_cycles: float = 4.0
    #: of which the level is not the lightest if another is so many standard deviations lighter,
    lighter_level_std: float = 2.0
    #: and how much likelier an emptying is where something else tells a change, and where a boom
    #: is extended than where it only moves.
    hinted_emptying_ratio: float = 20.0

    # prior_fit
    #: Deviations by which the ratio of variances exceeds 1 if groups disagree.
    disagreeing_std: float = 2.5
    #: Ratio to its noise from which what all groups miss alike counts.
    common_misfit_ratio: float = 2.0
    #: Fewest groups of which the fit takes nothing out of the residuals that must be put back.
    few_groups: int = 3

    # prior_solution
    #: Fraction of the correction for the columns' noise that is uncertain.
    uncertain_correction_fraction: float = 0.25
    #: Largest fraction of a direction's sum of squares that is taken for noise.
    max_noise_fraction: float = 0.5
    #: Rounds of the solution and the residuals' variance and correlation.
    solution_rounds: int = 4
    #: Added to the diagonal of the scores' covariance, over its trace: rounding.
    ridge_fraction: float = 1e-12


#: The values in use.
LIMITS: Final = JointLimits()
