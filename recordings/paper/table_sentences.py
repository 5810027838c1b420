"""Sentences on Tables 1 to 4: what was chosen, and where ours differ from the printed ones."""

from collections.abc import Mapping, Sequence
from typing import Final

from analysis.paper import printed_numbers
from analysis.paper.campaign_tables import Extremes, SweptTable, Table2
from analysis.paper.simulated_sources import THRESHOLD_NAT, WINDOW_SAMPLES
from analysis.paper.table1 import LONG_S, RARE, Table1
from recordings.paper.paper_wording import NAMES, ItemSentences, join_words, percent

_TABLE_1_CHOICES: Final = (
    "Noise of single samples, which the paper does not give, is that which comes nearest to its "
    "LS row: 60 N, 0.01 m/s² and 0.005 m/s, before the moving mean of 10 samples.",
    "The drive is the triangle of section 3.1 with f0 = 0, A/2 = 6 kN and a period of 15 s; mass "
    "and friction are 3614 kg and 2891 N·s/m.",
    "Windows start at a random phase of the steady oscillation and are not gated: the paper does "
    "not say where its windows start, and one trial a length is all that it seems to show.",
    "RLS sees what the others see: it starts from OLS over the first 0.2 s of the window.",
    "The bound is that of as many samples before the mean as the window has; `strict_bound_kg` in "
    "the CSV counts in the 9 earlier samples that its first means hold.",
    "Pooled LS over one ungated window is LS.",
)
_CAMPAIGN: Final = (
    "A campaign is six loads of 0 to 250 kg, nine runs each (the paper's N = 5 counts drums, not "
    "loads): 5 s standing, 3 s of full throttle, 2 s of cruise, braking; noise as in Table 1."
)
_ERRORS_CHOSEN: Final = (
    "The error is that of a single run after (19), with every load in the fit, and with the run's "
    "own load left out; that of the load means is in the CSV. The paper does not say which it "
    "prints; it fits and judges on the same loads.",
    "The bound is that of one run's mass from its samples in accepted windows, before (19), which "
    "is fitted to the errors with every load in the fit and so takes a little out of them.",
)


def table_1(found: Table1) -> ItemSentences:
    """Say what Table 1 shows."""
    return ItemSentences(
        _TABLE_1_CHOICES,
        (
            _one_trial(found),
            _best_length(found),
            _near_the_bound(found),
            _recursive(found),
            _raw_units(found),
        ),
    )


def _one_trial(found: Table1) -> str:
    return (
        f"Each printed number is one trial, ours are {found.frame['trials'].max()}: of the "
        f"{found.beside} printed numbers {found.below_bound} lie below the bound, which only luck "
        f"can do, and {found.rare} are larger than {RARE} times ours, where chance alone would "
        f"give {0.05 * found.beside:.0f}. The printed table scatters from one length to the next; "
        "the true error falls steadily."
    )


def _best_length(found: Table1) -> str:
    printed, ours = found.best_printed_s, found.best_s
    theirs = join_words(f"{NAMES[m]} at {at:g} s" for m, at in printed.items())
    mine = join_words(f"{NAMES[m]} at {ours[m]:g} s" for m in printed if m in ours)
    return (
        "The text calls 10 s optimal for all methods. Its own table is smallest for "
        f"{theirs}; ours for {mine}. The longest window that the manoeuvre allows is best, until "
        "the memory of RLS is full."
    )


def _near_the_bound(found: Table1) -> str:
    (low, high), (rms, *ends) = found.long_over_bound_1, found.long_rms_1
    errors = f"errors are {low:.2f} to {high:.2f} times it"
    if found.long_reached:
        reached = f"LS and TLS on scaled columns reach the Cramér–Rao bound: their {errors}."
    elif found.long_reached is None:
        reached = (
            "so few windows cannot tell whether LS and TLS on scaled columns reach the "
            f"Cramér–Rao bound: their {errors}, r.m.s. {rms:.2f} [{ends[0]:.2f}, {ends[1]:.2f}]."
        )
    else:
        reached = f"LS and TLS on scaled columns do not reach the Cramér–Rao bound: their {errors}."
    return (
        f"From {LONG_S:g} s on {reached} No unbiased regression on these samples can "
        "do better; FGLS is LS but for noise, since its weights are the residuals that they weigh."
    )


def _recursive(found: Table1) -> str:
    last = found.longest
    return (
        f"RLS forgets (λ = {found.forgetting_1:g}: half in {found.half_s:.1f} s), so a longer "
        f"window helps it little: at {last['window_s']:g} s it is at {last['over_bound_1']:.1f} "
        "times the bound."
    )


def _raw_units(found: Table1) -> str:
    raw, scaled = found.raw, found.scaled
    return (
        "TLS on raw units takes the noise of N, m/s² and m/s to be alike. With 150 N and "
        f"0.03 m/s² of noise its error at {raw['window_s']:g} s is {raw['rmse_kg']:.0f} kg "
        f"({raw['over_bound_1']:.1f} times the bound, and another number at every seed, for its "
        f"tails are heavy); on columns scaled by their noise it is {scaled['rmse_kg']:.0f} kg "
        f"({scaled['over_bound_1']:.2f} times). The printed TLS errors, mostly above LS, look like "
        "raw units."
    )


def table_2(found: Table2) -> ItemSentences:
    """Say what Table 2 shows."""
    chain, (alpha_1, beta_kg) = found.chain, found.printed
    ideal, through = found.ideal, found.chained
    return ItemSentences(
        (
            _CAMPAIGN,
            "The fit is that of `payscope calibrate`, on the means of each load's nine runs: the "
            "estimate on the reference, turned round. As (19) is printed, the reference on the "
            "estimate, noise of the estimates flattens the slope a little.",
            "The second set of columns is a what-if: sensors on the front wheels, which carry "
            f"{percent(chain.empty_share_1)} of the empty machine and, of a load "
            f"{chain.load_lever_1 - 1:.2f} wheelbases ahead of the front axle, "
            f"{percent(chain.load_lever_1)}; a torque gain of {chain.gain_1:g} and an offset of "
            f"{chain.offset_N / 1e3:g} kN; (17) without a share, as printed. The paper gives "
            "none of the four.",
        ),
        (
            f"The printed slopes near {alpha_1:.2f} say that raw masses rise "
            f"{1 / alpha_1:.0f} times as fast as the load. That is no effect of "
            f"noise: with an ideal torque chain LS has a slope of {ideal.alpha_1:.3f} "
            f"[{ideal.alpha_1_low:.3f}, {ideal.alpha_1_high:.3f}].",
            f"With the assumed torque chain LS has {through.alpha_1:.3f} and "
            f"{through.beta_kg:.0f} kg, the paper {alpha_1:.3f} and "
            f"{beta_kg:.0f} kg: plausible, not proven.",
            f"With so small a slope the offset is {percent(found.offset_share_1)} of the "
            "calibrated mass: the answer is nearly the mean of the reference masses, and nothing "
            "outside the loads it was fitted on should be read from it.",
        ),
    )


def table_3(found: SweptTable) -> ItemSentences:
    """Say what Table 3 shows."""
    return ItemSentences(
        (
            _CAMPAIGN,
            f"The window is held at {WINDOW_SAMPLES} samples, section 4.3's; the paper does not "
            "say what its Table 3 holds.",
            *_ERRORS_CHOSEN,
        ),
        (
            "The text says that most methods have their smallest error at 0.7 nat. Its table has "
            f"it at {_best_settings(found.best_printed, 'nat')}.",
            _extremes(found.extremes, "nat"),
            _nearest_bound(found.nearest_bound_1),
            "The printed columns jump by a factor of eight between neighbours (RLS 42.6 kg at 0.7, "
            "10.4 kg at 0.9); 54 runs of one campaign cannot tell neighbours apart.",
            _constant(found.best_kg),
        ),
    )


def table_4(found: SweptTable) -> ItemSentences:
    """Say what Table 4 shows."""
    return ItemSentences(
        (
            _CAMPAIGN,
            f"The threshold is held at {THRESHOLD_NAT} nat, section 4.3's; the paper does not say "
            "what its Table 4 holds. Its RLS column (10.4 to 10.9 kg at 300 and 400 samples) fits "
            "its Table 3 at 0.9 nat (10.4 kg), not at 0.7 nat (42.6 kg).",
            *_ERRORS_CHOSEN,
        ),
        (
            "The text says that 400 samples are best. Its table has the smallest error at "
            f"{_best_settings(found.best_printed, 'samples')}.",
            _extremes(found.extremes, "samples"),
            "The printed FGLS errors of 67.1 and 63.7 kg beside 17.5 and 15.1 kg of LS look like "
            "(16) without a guard, 1/r² at r near 0; with bounded weights FGLS follows LS.",
            _constant(found.best_kg),
        ),
    )


def _best_settings(best: Mapping[str, Sequence[float]], unit: str) -> str:
    return join_words(
        f"{' or '.join(f'{at:g}' for at in values)} {unit} for {NAMES[method]}"
        for method, values in best.items()
    )


def _extremes(methods: Sequence[Extremes], unit: str) -> str:
    """Where ours is smallest, and whether that is more than chance."""
    sentences: list[str] = []
    for each in methods:
        chance = (
            f"alike within the interval of the best: {join_words(f'{at:g}' for at in each.alike)}"
            if len(each.alike) < each.values
            else "all within the interval of the best"
        )
        sentences.append(
            f"{NAMES[each.method]} is smallest at {each.best:g} {unit} ({each.best_kg:.1f} kg) and "
            f"largest at {each.worst:g} {unit} ({each.worst_kg:.1f} kg; {chance})"
        )
    return f"Ours, own load left out: {'; '.join(sentences)}."


def _nearest_bound(nearest: Mapping[str, float]) -> str:
    """Compare pooled LS and RLS with the bound of one run."""
    return (
        f"Pooled LS comes to {nearest['pooled']:.2f} times the bound of one run. "
        f"RLS ({nearest['rls']:.2f} times the bound) is not held to it: it remembers "
        "the runs before, which had the same load but for the first of nine."
    )


def _constant(best_kg: float) -> str:
    return (
        "For scale: a prediction that ignores every measurement is wrong by "
        f"{printed_numbers.CONSTANT_KG:.0f} kg "
        f"({percent(printed_numbers.CONSTANT_KG / printed_numbers.MASS_KG, 1)} of the "
        f"machine); our best {best_kg:.1f} kg is "
        f"{percent(best_kg / printed_numbers.LOAD_RANGE_KG, 1)} of the payload range."
    )
