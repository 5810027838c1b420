"""Built-in limits of cycles and shift totals, which no machine file can set."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class CycleLimits:
    """Built-in limits of cycles and shift totals, which no machine file can set.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # cycles_without_mass: cycles that the boom alone shows
    #: Masses and boom agree if the boom dumps within so many ns of where the mass changes,
    dump_match_ns: int = 3 * 10**9
    #: for this fraction of the boom's dumps.
    dump_match_fraction: float = 0.7
    #: Smallest interval of two dumps, as a fraction of a usual cycle.
    min_dump_interval_cycles: float = 0.5
    #: Fewest cycles that decide.
    boom_min_cycles: int = 4
    #: Longest cycle, over the shortest interval of two fillings: a longer one may hold a filling
    #: whose digging was not seen.
    one_cycle_ratio: float = 1.5
    #: Masses and digging contradict each other if more than one load is hauled in this fraction.
    hauled_twice_fraction: float = 0.5
    #: Length in s of a hole up to which it loses no cycle.
    cycle_gap_s: float = 1.0

    # shift_totals
    #: Smallest load that is told from none, in standard deviations of one start's mass: 5 % of
    #: false loads and 5 % of missed ones (ISO 11843-1).
    min_detectable_std: float = 3.29

    # boom_dumps
    #: Fewest changes from loaded to empty in which the boom moves out,
    boom_min_changes: int = 3
    #: and their fraction, for a boom that shows dumps.
    boom_change_fraction: float = 0.7
    #: Quantiles of the boom's angle that are its reach on either side.
    boom_deflection_quantiles: tuple[float, float] = (0.01, 0.99)
    #: Reach upwards over that downwards from which a boom dumps by going up: 0.45 in a shift whose
    #: boom moves while driving, next to 0 where the angle's sign is wrong.
    boom_upward_fraction: float = 0.4
    #: Fraction of its reach in a middling dump beyond which a boom is out,
    boom_out_fraction: float = 0.5
    #: below which it has returned for certain: half of that,
    boom_in_fraction: float = 0.25
    #: and from which it is as far out as it gets.
    boom_up_fraction: float = 0.9
    #: Time in ns after that when a bucket is half empty, however long the boom stays up.
    emptying_ns: int = 2 * 10**9
    #: Fraction of the usual time with the boom out after which a bucket is half empty.
    emptied_fraction: float = 0.5
    #: Largest speed of a machine that dumps, as a fraction of the speed that it reaches,
    creeping_speed_fraction: float = 0.25
    #: which is this quantile of its speed.
    reached_speed_quantile: float = 0.95
    #: Reach of a boom, in rad, from which its movement shows dumps.
    boom_min_deflection_rad: float = 0.15
    #: Time in ns within which a boom that is out again shakes its bucket.
    one_dump_ns: int = 10 * 10**9

    # doubts about cycles in the ledger
    #: Coverage factor of a 95 % interval.
    coverage_factor: float = 2.0
    #: Largest fraction of its load that a bucket brings back: with more it was not emptied, or the
    #: empty drive was weighed wrong.
    max_carried_fraction: float = 0.25
    #: Robust standard deviations from the shift's median from which a load is unlike the others.
    unlike_load_std: float = 4.0
    #: Fewest loads that have a usual size.
    unlike_load_min_loads: int = 8

    # cycle_energy
    #: Longest hole in a cycle, in s, beyond which its energy is not known: a drive that pushes for
    #: so long takes about 1 % of the work of a cycle of 100 s, half of its interval.
    energy_gap_s: float = 0.5
    #: Fewest cycles that show how their friction scatters.
    friction_scatter_min_cycles: int = 4

    # cycle_parts
    #: Time without a sample in s in which a load may have been dumped.
    dump_gap_s: float = 5.0
    #: Length in s from which a stand is no part of the work.
    idle_s: float = 30.0

    # cycles
    #: Relative standard uncertainty from which a payload is doubted.
    doubtful_payload_u: float = 0.25

    # cycles_without_mass
    #: Probability that digging or a dump was a cycle if the log has no other witness,
    sole_witness_probability: float = 0.75
    #: and if it has one, which shows nothing.
    contradicted_probability: float = 0.25
    #: Number of confirmed or denied cycles that these two are worth.
    witness_prior_trials: float = 4.0
    #: Probability that a load is dumped where the recording goes on without its machine in view.
    unseen_dump_probability: float = 0.5
    #: Time in ns behind the last haul in which a recording may have a dump.
    unseen_dump_ns: int = 3 * 10**9
    #: Relative standard deviation of loads where a single one is known.
    single_load_std_fraction: float = 0.5
    #: Relative deviation from the median within which an interval of dumps is one cycle,
    rhythm_tolerance: float = 0.25
    #: and fraction of such intervals that is a rhythm.
    rhythm_min_fraction: float = 0.6
    #: Interval of two starts below which they are of one haul, over the median one of hauls.
    one_haul_cycles: float = 0.25
    #: Fewest dumps that have a rhythm.
    rhythm_min_dumps: int = 6
    #: Fraction of the counted cycles with digging from which digging is a witness.
    digging_witness_fraction: float = 0.5
    #: Fewest dumps that have a period.
    period_min_dumps: int = 3
    #: Period over the middling one from which it has idling in it.
    idle_period_ratio: float = 2.5
    #: Cycles that a gap hides up to which it is taken for work: a longer one is as likely a break.
    working_gap_max_cycles: float = 5.0
    #: Gap in s that ends a shift: no break is so long, and what follows is another shift's work.
    break_max_s: float = 14_400.0

    # empty_machine
    #: Quantile of the empty passes that is the clean bucket: the least of many is the noisiest.
    clean_bucket_quantile: float = 0.1
    #: Fewest empty passes that show how what is carried back differs.
    carried_min_passes: int = 4
    #: Standard uncertainty of what the cleanest bucket still carries, over the mean: of loads
    #: left that are spread evenly from nothing on, a tenth percentile has 0.2, of an exponential
    #: tail 0.1.
    clean_bucket_u: float = 0.25
    #: Fewest starts on either side of a border.
    border_side_min_starts: int = 4
    #: Quantile of the starts of a side that is its empty machine,
    empty_start_quantile: float = 0.2
    #: if this quantile,
    loaded_start_quantile: float = 0.8
    #: is heavier by this fraction: of a side that is loaded throughout none is.
    loaded_start_excess: float = 0.08
    #: Relative difference of two machines' empty masses,
    empty_mass_jump: float = 0.15
    #: and in standard uncertainties.
    empty_mass_jump_u: float = 4.0

    # energy_integrals
    #: Longest time that a sample stands for, in s: a longer step is a hole.
    longest_sample_s: float = 1.0
    #: Smallest smoothed force along the speed that drives, as a fraction of the largest: coasting
    #: has none but noise.
    min_drive_force_fraction: float = 0.05

    # energy_terms
    #: Fewest stands that show the offset of the force,
    force_offset_min_stands: int = 12
    #: and combined standard uncertainties from which it contradicts the fit's.
    offset_contradiction_u: float = 3.0

    # friction_trend
    #: Fewest shifts that have a trend: a line through three has one degree of freedom.
    friction_min_days: int = 4
    #: Usual number of parts of a shift.
    friction_parts: int = 8
    #: Shortest part, in s,
    shortest_friction_part_s: float = 300.0
    #: and longest.
    longest_friction_part_s: float = 3600.0
    #: Fewest manoeuvres that show how they scatter.
    friction_min_manoeuvres: int = 4

    # haul_spillage
    #: Sums of squares of accelerations below this, in m²/s⁴, are rounding.
    min_acceleration_square: float = 1e-12

    # load_passes
    #: A haul that lasts less than this fraction of the usual one hauls nothing, unless it digs,
    short_haul_fraction: float = 0.3
    #: if the empty manoeuvres beside it are closer than this fraction of the usual: those beside a
    #: haul of which only a part was weighed are as far apart as ever.
    short_between_fraction: float = 0.5
    #: Fraction of a usual load that remains in an empty body, at most.
    rest_max_fraction: float = 0.2
    #: Distance of the means of loaded and empty, in standard deviations of a state,
    class_distance_std: float = 4.0
    #: and of means of classes that digging or taking turns separates, in their own.
    digging_class_distance_std: float = 3.0
    #: Fraction of the states that are heavier than both neighbours or lighter, by which loaded and
    #: empty take turns: of masses that are independent two thirds are,
    alternating_min_fraction: float = 0.9
    #: or so many standard deviations more than of independent masses.
    alternating_std: float = 3.0
    #: Standard deviations from which a state that is lighter after digging has not dug.
    not_dug_std: float = 3.0
    #: Smallest spread of empty passes, as a fraction of a load: what is carried back has a long
    #: tail,
    min_empty_spread: float = 0.05
    #: and of loaded passes, likewise.
    min_loaded_spread: float = 0.1
    #: Fewest states that have a spread of their own.
    own_spread_min_states: int = 4
    #: Standard deviations by which the states of a pass differ if the load changes on the way.
    other_load_std: float = 3.0
    #: Largest fraction of a load that is spilled on a haul: 0.1 to 0.25 are usual.
    spilled_max_fraction: float = 0.35
    #: Time from dump to dump, in usual cycles, below which the second one dumps the rest of a load.
    rest_max_cycles: float = 0.6
    #: Fraction of loads with digging from which digging shows fillings.
    digging_min_fraction: float = 0.5
    #: Fewest cycles that show how long one lasts.
    filling_min_cycles: int = 4
    #: Largest interval in ns of starts that dig and are one filling of the bucket, nothing between,
    max_filling_pause_ns: int = 25 * 10**9
    #: and as a fraction of the time from digging to digging over an empty pass; the shorter holds.
    one_filling_cycles: float = 0.5

    # payload_target
    #: Largest fraction of loads above 110 % of the target; the mean is at most the target, no load
    #: above 120 % (Caterpillar, Mining Truck Payload Policy 10/10/20).
    above_target_fraction: float = 0.10
    #: Load over the target from which it counts as above,
    above_target_ratio: float = 1.1
    #: and which none may exceed.
    never_above_ratio: float = 1.2
    #: Standard deviations from a border at which a load is surely beyond it.
    sure_border_std: float = 2.0


#: The values in use.
LIMITS: Final = CycleLimits()
