"""Write the sentences on Tables 1 to 4 and Figures 2 to 8: choices made, and findings."""

from collections.abc import Mapping, Sequence
from typing import Final

from analysis.paper import printed_numbers
from analysis.paper.campaign_figures import Figure5, Figure6, Figure7, Figure8
from analysis.paper.campaign_tables import ErrorExtremes, SweptTable, Table2
from analysis.paper.excitation_figures import Figure2, Figure3, Figure4
from analysis.paper.paper_limits import LIMITS as PAPER_LIMITS
from analysis.paper.table1 import LONG_S, RARE, Table1
from recordings.paper.paper_wording import (
    NAMES,
    NO_NUMBERS,
    ItemSentences,
    format_percent,
    join_words_as_list,
)

_TABLE_1_CHOICES: Final = (
    "The noise of single samples, which the paper does not give, is chosen to come nearest to its "
    "LS row: 60 N, 0.01 m/s² and 0.005 m/s, before the moving mean of 10 samples.",
    "The drive is the triangle of section 3.1 with f0 = 0, A/2 = 6 kN and a period of 15 s; mass "
    "and friction are 3614 kg and 2891 N·s/m.",
    "Windows start at a random phase of the steady oscillation and are not gated: the paper does "
    "not say where its windows start, and seems to show a single trial for each length.",
    "RLS sees what the others see: it starts from OLS over the first 0.2 s of the window.",
    "The bound counts as many samples before the mean as the window has; `strict_bound_kg` in the "
    "CSV also counts the 9 earlier samples that the first means of the window contain.",
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
    "The bound is for one run's mass from its samples in accepted windows, before (19). With every "
    "load in the fit, (19) is fitted to the errors that it corrects, and so makes them smaller.",
)
_NO_GATE: Final = "Every complete window is used: the paper does not say that it gates here."
#: Range of the ratio of two errors within which they count as similar.
_ALIKE: Final = (0.8, 1.25)


def make_mass_error_table_sentences(numbers: Table1) -> ItemSentences:
    """Say what Table 1 shows."""
    return ItemSentences(
        _TABLE_1_CHOICES,
        (
            _make_printed_single_trials_sentence(numbers),
            _make_best_window_length_sentence(numbers),
            _make_cramer_rao_bound_sentence(numbers),
            _make_recursive_methods_sentence(numbers),
            _make_raw_units_sentence(numbers),
        ),
    )


def _make_printed_single_trials_sentence(numbers: Table1) -> str:
    return (
        f"Each printed number is one trial, ours are {numbers.frame['trials'].max()}: of the "
        f"{numbers.printed_count} printed numbers {numbers.below_bound} lie below the bound, which "
        f"only luck can do, and {numbers.improbably_large_count} are larger than {RARE} times "
        f"ours, where chance alone would give {0.05 * numbers.printed_count:.0f}. The printed "
        "table scatters from one length to the next; the true error falls steadily."
    )


def _make_best_window_length_sentence(numbers: Table1) -> str:
    printed, ours = numbers.best_printed_s, numbers.best_s
    theirs = join_words_as_list(f"{NAMES[m]} at {at:g} s" for m, at in printed.items())
    mine = join_words_as_list(f"{NAMES[m]} at {ours[m]:g} s" for m in printed if m in ours)
    return (
        "The text calls 10 s optimal for all methods. The error in its own table is smallest for "
        f"{theirs}; in ours for {mine}. The longest window that the manoeuvre allows is best, "
        "until the memory of RLS is full."
    )


def _make_cramer_rao_bound_sentence(numbers: Table1) -> str:
    (low, high), (rms, *ends) = numbers.long_over_bound_1, numbers.long_rms_1
    errors = f"errors are {low:.2f} to {high:.2f} times it"
    if numbers.long_reached:
        reached = f"LS and TLS on scaled columns reach the Cramér–Rao bound: their {errors}."
    elif numbers.long_reached is None:
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


def _make_recursive_methods_sentence(numbers: Table1) -> str:
    last = numbers.longest
    return (
        f"RLS forgets (λ = {numbers.forgetting_1:g}: half in {numbers.memory_half_life_s:.1f} s), "
        f"so a longer window helps it little: at {last['window_s']:g} s it is at "
        f"{last['over_bound_1']:.1f} times the bound."
    )


def _make_raw_units_sentence(numbers: Table1) -> str:
    raw, scaled = numbers.raw, numbers.scaled
    return (
        "TLS on raw units takes the noise of N, m/s² and m/s to be alike. With 150 N and "
        f"0.03 m/s² of noise its error at {raw['window_s']:g} s is {raw['rmse_kg']:.0f} kg "
        f"({raw['over_bound_1']:.1f} times the bound, and a different number for every seed, since "
        f"its tails are heavy); on columns scaled by their noise it is {scaled['rmse_kg']:.0f} kg "
        f"({scaled['over_bound_1']:.2f} times). The printed TLS errors, mostly above LS, look like "
        "raw units."
    )


def make_calibration_line_table_sentences(numbers: Table2) -> ItemSentences:
    """Say what Table 2 shows."""
    chain, (alpha_1, beta_kg) = numbers.chain, numbers.printed
    ideal, through = numbers.ideal, numbers.chained
    return ItemSentences(
        (
            _CAMPAIGN,
            "The fit is that of `payscope calibrate`, on the means of each load's nine runs: the "
            "estimate on the reference, turned round. As (19) is printed, the reference on the "
            "estimate, noise of the estimates flattens the slope a little.",
            "The second set of columns is a what-if: sensors on the front wheels, which carry "
            f"{format_percent(chain.empty_fraction_1)} of the empty machine and, of a load "
            f"{chain.load_lever_1 - 1:.2f} wheelbases ahead of the front axle, "
            f"{format_percent(chain.load_lever_1)}; a torque gain of {chain.gain_1:g} and an "
            "offset of "
            f"{chain.offset_N / 1e3:g} kN; (17) without a share, as printed. The paper gives "
            "none of the four.",
        ),
        (
            f"The printed slopes near {alpha_1:.2f} say that raw masses rise "
            f"{1 / alpha_1:.0f} times as fast as the load. That is no effect of "
            f"noise: with an ideal torque chain LS has a slope of {ideal.alpha_1:.3f} "
            f"[{ideal.alpha_1_low:.3f}, {ideal.alpha_1_high:.3f}].",
            f"With the assumed torque chain LS has a slope of {through.alpha_1:.3f} and an offset "
            f"of {through.beta_kg:.0f} kg, the paper {alpha_1:.3f} and "
            f"{beta_kg:.0f} kg: plausible, not proven.",
            f"With so small a slope the offset is {format_percent(numbers.offset_share_1)} of the "
            "calibrated mass: the answer is nearly the mean of the reference masses, and nothing "
            "outside the loads it was fitted on should be read from it.",
        ),
    )


def make_method_error_table_sentences(numbers: SweptTable) -> ItemSentences:
    """Say what Table 3 shows."""
    return ItemSentences(
        (
            _CAMPAIGN,
            f"The window is fixed at {PAPER_LIMITS.fixed_window_samples} samples, as in section "
            "4.3; the paper does not say which window its Table 3 uses.",
            *_ERRORS_CHOSEN,
        ),
        (
            "The text says that most methods have their smallest error at 0.7 nat. Its table has "
            f"it at {_format_best_settings(numbers.best_printed, 'nat')}.",
            _make_smallest_error_sentence(numbers.extremes, "nat"),
            _make_nearest_bound_sentence(numbers.nearest_bound_1),
            "The printed columns jump by a factor of eight between neighbours (RLS 42.6 kg at 0.7, "
            "10.4 kg at 0.9); 54 runs of one campaign cannot tell neighbours apart.",
            _make_constant_predictor_sentence(numbers.best_kg),
        ),
    )


def make_swept_setting_table_sentences(numbers: SweptTable) -> ItemSentences:
    """Say what Table 4 shows."""
    return ItemSentences(
        (
            _CAMPAIGN,
            f"The threshold is held at {PAPER_LIMITS.fixed_threshold_nat} nat, section 4.3's; the "
            "paper does not say what its Table 4 holds. Its RLS column (10.4 to 10.9 kg at 300 and "
            "400 samples) fits its Table 3 at 0.9 nat (10.4 kg), not at 0.7 nat (42.6 kg).",
            *_ERRORS_CHOSEN,
        ),
        (
            "The text says that 400 samples are best. Its table has the smallest error at "
            f"{_format_best_settings(numbers.best_printed, 'samples')}.",
            _make_smallest_error_sentence(numbers.extremes, "samples"),
            "The printed FGLS errors of 67.1 and 63.7 kg beside 17.5 and 15.1 kg of LS look like "
            "(16) without a guard, 1/r² at r near 0; with bounded weights FGLS follows LS.",
            _make_constant_predictor_sentence(numbers.best_kg),
        ),
    )


def _format_best_settings(settings_by_method: Mapping[str, Sequence[float]], unit: str) -> str:
    return join_words_as_list(
        f"{' or '.join(f'{at:g}' for at in values)} {unit} for {NAMES[method]}"
        for method, values in settings_by_method.items()
    )


def _make_smallest_error_sentence(methods: Sequence[ErrorExtremes], unit: str) -> str:
    """Say at which setting our error is smallest, and whether that is significant."""
    sentences: list[str] = []
    for each in methods:
        chance = (
            f"within the interval of the best: {join_words_as_list(f'{at:g}' for at in each.alike)}"
            if len(each.alike) < each.values
            else "all within the interval of the best"
        )
        sentences.append(
            f"{NAMES[each.method]} is smallest at {each.best:g} {unit} ({each.best_kg:.1f} kg) and "
            f"largest at {each.worst:g} {unit} ({each.worst_kg:.1f} kg; {chance})"
        )
    return f"Our errors, own load left out: {'; '.join(sentences)}."


def _make_nearest_bound_sentence(nearest_method: Mapping[str, float]) -> str:
    """Compare pooled LS and RLS with the bound of one run, in a sentence."""
    return (
        f"Pooled LS comes to {nearest_method['pooled']:.2f} times the bound of one run. "
        f"RLS ({nearest_method['rls']:.2f} times the bound) is not held to it: it remembers "
        "the runs before, which had the same load but for the first of nine."
    )


def _make_constant_predictor_sentence(best_error_kg: float) -> str:
    return (
        "For scale: a prediction that ignores every measurement is wrong by "
        f"{printed_numbers.CONSTANT_KG:.0f} kg "
        f"({format_percent(printed_numbers.CONSTANT_KG / printed_numbers.MASS_KG, 1)} of the "
        f"machine); our best {best_error_kg:.1f} kg is "
        f"{format_percent(best_error_kg / printed_numbers.LOAD_RANGE_KG, 1)} of the payload range."
    )


def make_excitation_figure_sentences(numbers: Figure2) -> ItemSentences:
    """Say what Figure 2 shows."""
    return ItemSentences(
        (
            "0 to 6 kN with a period of 15 s, from standing, with the noise of Table 1 and the "
            "moving mean.",
        ),
        (
            f"The machine's time constant m/b is {numbers.constant_s:.2f} s; the paper's response "
            f"time T ≈ {printed_numbers.RESPONSE_S:g} s is where a step has settled to "
            f"{format_percent(numbers.unsettled_1)}, and its period 3 T lets it settle twice.",
            "The triangle as printed, (A/T)|t mod T - T/2| + f0, is highest at t = 0 and ranges "
            "over A/2, not A.",
            NO_NUMBERS,
        ),
    )


def make_convergence_figure_sentences(numbers: Figure3) -> ItemSentences:
    """Say what Figure 3 shows."""
    return ItemSentences(
        (_NO_GATE,),
        (
            _make_rms_about_truth_sentence(numbers.rms_kg, numbers.true_mass_kg, "kg"),
            _make_convergence_time_sentence(numbers),
            NO_NUMBERS,
        ),
    )


def make_spin_figure_sentences(numbers: Figure4) -> ItemSentences:
    """Say what Figure 4 shows."""
    bias = numbers.bias_kg_m2
    return ItemSentences(
        (
            _NO_GATE,
            "The paper gives neither inertia nor torque: "
            f"{numbers.true_inertia_z_kg_m2:g} kg·m², {numbers.true_friction_z_N_m_s:g} N·m·s and "
            "0 "
            "to 3 kN·m are assumed. The yaw acceleration is the gyroscope's derivative; TLS takes "
            "its noise from the standstill at the end.",
            "The yaw row of (8) alone: its other two rows, as printed, hold for I13 = I23 = 0 "
            "only.",
        ),
        (
            _make_rms_about_truth_sentence(
                numbers.rms_kg_m2, numbers.true_inertia_z_kg_m2, "kg·m²"
            ),
            f"The noise of a differentiated gyroscope biases LS by {bias['ls']:+.0f} kg·m², and "
            f"FGLS with it; TLS, which knows that noise, by {bias['tls']:+.0f} kg·m².",
            NO_NUMBERS,
        ),
    )


def _make_rms_about_truth_sentence(rms: Mapping[str, float], true_value: float, unit: str) -> str:
    each = join_words_as_list(
        f"{NAMES[method]} {error:.0f} {unit}" for method, error in rms.items()
    )
    return f"R.m.s. over the figure about the true {true_value:g} {unit}: {each}."


def _make_convergence_time_sentence(numbers: Figure3) -> str:
    ls, rls = numbers.converging["ls"], numbers.converging["rls"]
    low, high = _ALIKE
    later = rls.later_kg / ls.later_kg
    sensitive = (
        "about as sensitive to noise as" if low < later < high else "less sensitive to noise than"
    )
    sensitive = "more sensitive to noise than" if later >= high else sensitive
    return (
        f"In the first {PAPER_LIMITS.converging_s:g} s after the first window RLS strays by "
        f"{rls.early_kg:.0f} kg r.m.s., LS by {ls.early_kg:.0f} kg; later by "
        f"{rls.later_kg:.0f} and {ls.later_kg:.0f} kg. RLS is slower to converge, as the "
        "paper says: it starts from the OLS estimate of the first window, but with P0 = I/σ² it "
        f"takes that for little more than a guess. Later it is {sensitive} LS: its weights are "
        f"worth (1 + λ)/(1 - λ) = {numbers.memory_samples:.0f} samples, a window of "
        f"{PAPER_LIMITS.optimal_window_s:g} s holds {numbers.window_samples}."
    )


def make_gate_figure_sentences(numbers: Figure5) -> ItemSentences:
    """Say what Figure 5 shows."""
    highest = join_words_as_list(
        f"{nat:.1f} nat while {phase}" for phase, nat in numbers.highest_nat.items()
    )
    return ItemSentences(
        ("The first run of a simulated campaign, without load; the window is 320 samples.",),
        (
            f"The index reaches {highest}. The paper, too, sees it large while decelerating; but "
            "braking takes a hydraulic path that the torque sensors do not see, so a window that "
            "contains braking is refused whatever its index.",
            NO_NUMBERS,
        ),
    )


def make_raw_mass_figure_sentences(numbers: Figure6) -> ItemSentences:
    """Say what Figure 6 shows."""
    first_kg, last_kg = numbers.implied_kg
    return ItemSentences(
        (
            "Means of nine runs over the campaigns, ± the standard deviation of one run; the "
            "dashed lines are the masses that the paper measured, as Table 2 implies them.",
        ),
        (
            f"With an ideal torque chain raw means are within {numbers.bias_kg:.0f} kg of the "
            "truth "
            f"before any calibration. Table 2 implies raw LS masses from {first_kg:,.0f} to "
            f"{last_kg:,.0f} kg for a machine of 3614 to 3864 kg: the paper's torque "
            "chain, not its estimators, is what its calibration corrects.",
            NO_NUMBERS,
        ),
    )


def make_calibrated_mass_figure_sentences(numbers: Figure7) -> ItemSentences:
    """Say what Figure 7 shows."""
    scatter = join_words_as_list(
        f"{NAMES[method]} {std:.1f} kg" for method, std in numbers.scatter_kg.items()
    )
    return ItemSentences(
        ("Means of nine runs over the campaigns, ± the standard deviation of one run.",),
        (f"One run's calibrated mass scatters by {scatter}.", NO_NUMBERS),
    )


def make_error_figure_sentences(numbers: Figure8) -> ItemSentences:
    """Say what Figure 8 shows."""
    return ItemSentences(
        (
            "R.m.s. over a load's nine runs, mean over the campaigns with its 95 % interval; solid "
            "bars have the load in the fit, as in the paper, hatched ones do not.",
        ),
        (
            "Leaving a load out of the fit costs most at the ends of the range: "
            f"{numbers.ends_1:.2f} times the in-sample error at 0 and 250 kg, "
            f"{numbers.middle_1:.2f} times between.",
            NO_NUMBERS,
        ),
    )
