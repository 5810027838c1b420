"""Sentences on Figures 2 to 8: what was chosen, and what they show."""

from collections.abc import Mapping
from typing import Final

from analysis.paper import printed_numbers
from analysis.paper.campaign_figures import Figure5, Figure6, Figure7, Figure8
from analysis.paper.excitation_figures import EARLY_S, WINDOW_S, Figure2, Figure3, Figure4
from recordings.paper.paper_wording import NAMES, NO_NUMBERS, ItemSentences, join_words, percent

_NO_GATE: Final = "Every complete window is used: the paper does not say that it gates here."
#: Errors whose ratio is between these are called alike.
_ALIKE: Final = (0.8, 1.25)


def figure_2(found: Figure2) -> ItemSentences:
    """Say what Figure 2 shows."""
    return ItemSentences(
        (
            "0 to 6 kN with a period of 15 s, from standing, with the noise of Table 1 and the "
            "moving mean.",
        ),
        (
            f"The machine's time constant m/b is {found.constant_s:.2f} s; the paper's response "
            f"time T ≈ {printed_numbers.RESPONSE_S:g} s is where a step has settled to "
            f"{percent(found.unsettled_1)}, and its period 3 T lets it settle twice.",
            "The triangle as printed, (A/T)|t mod T - T/2| + f0, is highest at t = 0 and ranges "
            "over A/2, not A.",
            NO_NUMBERS,
        ),
    )


def figure_3(found: Figure3) -> ItemSentences:
    """Say what Figure 3 shows."""
    return ItemSentences(
        (_NO_GATE,),
        (
            _about_the_truth(found.rms_kg, found.true_mass_kg, "kg"),
            _converging(found),
            NO_NUMBERS,
        ),
    )


def figure_4(found: Figure4) -> ItemSentences:
    """Say what Figure 4 shows."""
    bias = found.bias_kg_m2
    return ItemSentences(
        (
            _NO_GATE,
            "The paper gives neither inertia nor torque: "
            f"{found.true_inertia_z_kg_m2:g} kg·m², {found.true_friction_z_N_m_s:g} N·m·s and 0 "
            "to 3 kN·m are assumed. The yaw acceleration is the gyroscope's derivative; TLS takes "
            "its noise from the standstill at the end.",
            "The yaw row of (8) alone: its other two rows, as printed, hold for I13 = I23 = 0 "
            "only.",
        ),
        (
            _about_the_truth(found.rms_kg_m2, found.true_inertia_z_kg_m2, "kg·m²"),
            f"The noise of a differentiated gyroscope biases LS by {bias['ls']:+.0f} kg·m², and "
            f"FGLS with it; TLS, which knows that noise, by {bias['tls']:+.0f} kg·m².",
            NO_NUMBERS,
        ),
    )


def _about_the_truth(rms: Mapping[str, float], true: float, unit: str) -> str:
    each = join_words(f"{NAMES[method]} {error:.0f} {unit}" for method, error in rms.items())
    return f"R.m.s. over the figure about the true {true:g} {unit}: {each}."


def _converging(found: Figure3) -> str:
    ls, rls = found.converging["ls"], found.converging["rls"]
    low, high = _ALIKE
    later = rls.later_kg / ls.later_kg
    sensitive = (
        "about as sensitive to noise as" if low < later < high else "less sensitive to noise than"
    )
    sensitive = "more sensitive to noise than" if later >= high else sensitive
    return (
        f"In the first {EARLY_S:g} s after the first window RLS strays by "
        f"{rls.early_kg:.0f} kg r.m.s., LS by {ls.early_kg:.0f} kg; later by "
        f"{rls.later_kg:.0f} and {ls.later_kg:.0f} kg. RLS is slower to converge, as the "
        "paper says: it starts from the OLS estimate of the first window, but with P0 = I/σ² it "
        f"takes that for little more than a guess. Later it is {sensitive} LS: its weights are "
        f"worth (1 + λ)/(1 - λ) = {found.memory_samples:.0f} samples, a window of {WINDOW_S:g} s "
        f"holds {found.window_samples}."
    )


def figure_5(found: Figure5) -> ItemSentences:
    """Say what Figure 5 shows."""
    highest = join_words(f"{nat:.1f} nat while {phase}" for phase, nat in found.highest_nat.items())
    return ItemSentences(
        ("The first run of a simulated campaign, without load; the window is 320 samples.",),
        (
            f"The index reaches {highest}. The paper, too, sees it large while decelerating; but "
            "braking takes another hydraulic path than the torque sensors see, so a window that "
            "contains braking is refused whatever its index.",
            NO_NUMBERS,
        ),
    )


def figure_6(found: Figure6) -> ItemSentences:
    """Say what Figure 6 shows."""
    first_kg, last_kg = found.implied_kg
    return ItemSentences(
        (
            "Means of nine runs over the campaigns, ± the standard deviation of one run; the "
            "dashed lines are what Table 2 implies that the paper measured.",
        ),
        (
            f"With an ideal torque chain raw means are within {found.bias_kg:.0f} kg of the truth "
            f"before any calibration. Table 2 implies raw LS masses from {first_kg:,.0f} to "
            f"{last_kg:,.0f} kg for a machine of 3614 to 3864 kg: the paper's torque "
            "chain, not its estimators, is what its calibration corrects.",
            NO_NUMBERS,
        ),
    )


def figure_7(found: Figure7) -> ItemSentences:
    """Say what Figure 7 shows."""
    scatter = join_words(
        f"{NAMES[method]} {std:.1f} kg" for method, std in found.scatter_kg.items()
    )
    return ItemSentences(
        ("Means of nine runs over the campaigns, ± the standard deviation of one run.",),
        (f"One run's calibrated mass scatters by {scatter}.", NO_NUMBERS),
    )


def figure_8(found: Figure8) -> ItemSentences:
    """Say what Figure 8 shows."""
    return ItemSentences(
        (
            "R.m.s. over a load's nine runs, mean over the campaigns with its 95 % interval; solid "
            "bars have the load in the fit, as in the paper, hatched ones do not.",
        ),
        (
            "Leaving a load out of the fit costs most at the ends of the range: "
            f"{found.ends_1:.2f} times the in-sample error at 0 and 250 kg, "
            f"{found.middle_1:.2f} times between.",
            NO_NUMBERS,
        ),
    )
