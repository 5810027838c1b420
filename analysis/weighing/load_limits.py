"""Built-in limits of loads, hauls and the ground below, which no machine file can set."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class LoadLimits:
    """Built-in limits of loads, hauls and the ground below, which no machine file can set.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # gain_by_direction
    #: Fewest turns from which loads may be a gain by direction,
    direction_gain_min_turns: int = 3
    #: and share of the manoeuvres whose loads go by it, unless boom or bucket tell of so many.
    loads_by_direction_fraction: float = 0.8
    hinted_loads_fraction: float = 0.4
    #: Standard deviations from which such a gain shows, its least size and the largest of a sensor.
    direction_gain_min_std: float = 6.0
    direction_gain_min_1: float = 0.005
    direction_gain_max_1: float = 0.25
    #: Probability by which a constant load scatters in one direction as payloads do.
    payload_scatter_probability: float = 0.01

    # growing_load
    #: Top speed of a manoeuvre that creeps, over the median: shunting is at a walk, hauling not.
    creep_speed_ratio: float = 0.35
    #: Fewest rows of a manoeuvre that shows a growing load.
    growth_min_rows: int = 20
    #: Share of a column's squares below which what is left is rounding.
    column_rounding_fraction: float = 1e-12
    #: Fewest manoeuvres that show what is usual.
    growth_min_manoeuvres: int = 4
    #: Rows that miss by more standard deviations count as missing by so many.
    row_clip_std: float = 4.0
    #: Probability that any manoeuvre of a log is reported by chance.
    growth_false_alarm_probability: float = 0.01
    #: Standard deviations from which a growth in every start widens the masses of a machine that
    #: nothing fills: of 400 clean logs one has more.
    impossible_filling_std: float = 3.0
    #: A mass of so many times the median is none: 76 t hid the border between 2.2 and 2.7 t. A
    #: truck weighs three times its tare when loaded, a shunter with wagons five times.
    max_mass_over_median: float = 10.0
    #: Largest change of a load over the machine's mass: no loader carries its own mass.
    max_growth_fraction: float = 1.0
    #: Rounds of reweighting for least absolute deviations.
    least_absolute_rounds: int = 20
    #: Largest change of a load over the range of the loads: empty starts "lost" 4 t beside 0.8 t.
    max_load_change_ratio: float = 2.0
    #: Standard deviation of a start's own friction, as a share of it.
    own_friction_fraction: float = 0.1
    #: Standard deviation of a start's own constant, as a share of the largest force.
    own_constant_fraction: float = 0.01
    #: Smallest share of a term's variance that is its own; with less it cannot be separated.
    min_own_variance_fraction: float = 1e-9

    # load_frames
    #: The lightest state is empty if its mass is the machine's within so many uncertainties,
    empty_state_u: float = 2.0
    #: and the heaviest is heavier by so many.
    heaviest_state_u: float = 3.0
    #: A machine that contradicts its stated mass is empty where it returns so often to its least.
    returns_min: int = 4
    #: Share of forward driving by which light and heavy states differ if it tells them apart.
    returns_one_way: float = 0.5
    #: States are equally light within so many standard deviations of their difference.
    equally_light_std: float = 3.0
    #: Manoeuvres that are named; the others are counted.
    max_named_manoeuvres: int = 3
    #: Shortest motion between two standstills that may haul a load, in s,
    drive_min_s: float = 5.0
    #: time of fitted samples from which its start is usable, in s: a few determine no mass,
    usable_start_min_s: float = 0.5
    #: and fraction of those with a usable start below which loads may be lost unseen: a half.
    fitted_drives_min_fraction: float = 0.5

    # load_states
    #: Largest load, as a share of the machine's mass (rated loads of loaders).
    largest_load_fraction: float = 1.0 / 3.0
    #: Repeatability of one load, as a share of the machine's mass: loader scales state 1 or 2 %.
    repeatability_fraction: float = 0.02
    #: One load is not ruled out above this probability.
    single_load_min_probability: float = 0.05
    #: Several loads are not while all their partitions together exceed this: some fit chance.
    several_loads_min_probability: float = 0.2
    #: Probability of a single load that uneven ground explains as well as loads do: even odds.
    single_or_several_probability: float = 0.5
    #: Loads that a fit of one load hides are taken below this probability of one.
    hidden_loads_max_single_probability: float = 1e-6
    #: Loads that change on the move are taken below this: of one load it was 0.88 and more in 24
    #: logs of five machines, of ten loads below 1e-5.
    on_the_move_max_single_probability: float = 1e-3
    #: Reversals from heavier to lighter or back from which a load returns, about to the kilogram.
    load_return_reversals: int = 2
    #: Movement of a boom or bucket between manoeuvres that may load or dump, in rad.
    arm_movement_rad: float = 0.15
    #: Shortest manoeuvre that determines a mass, in s,
    informative_manoeuvre_s: float = 0.5
    #: and its fewest samples.
    informative_manoeuvre_samples: int = 10
    #: Change of speed of a manoeuvre that determines a mass, as a share of the usual one's.
    informative_speed_share: float = 0.1
    #: Manoeuvres disagree if the ratio of variances exceeds 1 by so many standard deviations.
    excess_scatter_std: float = 5.0
    #: Degrees of freedom from which the manoeuvres show how they scatter.
    scatter_min_degrees_of_freedom: int = 4
    #: Change of the load that the masses alone show, in repeatabilities, below which scatter may
    #: have made it: of buses whose load changes by less at every start payloads were 6 u off.
    small_change_repeatabilities: float = 5.0
    #: Bisections that find the scatter: to the last digit.
    scatter_rounds: int = 60

    # uneven_ground
    #: Fraction of the samples from which a direction has ground of its own.
    direction_min_fraction: float = 0.05
    #: Distances in m from where a stretch begins between which the ground's force goes on a line: a
    #: machine's length or two while it gains speed. Farther on the ground is the route's.
    loading_places_m: tuple[float, float, float] = (0.0, 2.0, 6.0)
    #: Length of way, in m, over which the ground's force changes by `ground_change_share`.
    ground_change_m: float = 10.0
    #: Places along the route between which it does likewise.
    route_parts: int = 24
    #: Shortest route in m with a grade of its own: twice what the terms of a start reach.
    grade_min_route_m: float = 12.0
    #: Fewest manoeuvres of a log whose loads are searched with the ground in the fit: in shorter
    #: ones it explains loads (record 0164).
    ground_min_manoeuvres: int = 24

    # haul_route
    #: Distance of two stands at one place, over the usual way between turns: piles creep by a tenth
    #: of a haul.
    same_place_1: float = 0.12
    #: Runs between turns of which at least one ends at a place,
    runs_per_visit: int = 8
    #: which has at least so many visits.
    place_min_visits: int = 4
    #: Fraction of the manoeuvres from which states that go by the direction may be nothing else,
    direction_state_fraction: float = 0.9
    #: unless a boom or digging hints at this fraction of their changes: nearly one of two.
    hinted_change_fraction: float = 0.4
    #: Places that are combined: those with the most visits.
    max_places: int = 6
    #: Length of the route over the median haul: loads are not all taken at one place. An edge of
    #: the ground at 2.4 to 3.2 m, where half the starts began, left loads a third too light without
    #: it.
    route_over_haul: float = 1.2
    #: Distance of braking for a dump, over the usual one, beyond which the machine has left it
    #: since.
    dump_stop_ratio: float = 2.0
    #: Largest distance, as a fraction of a cycle, of a missed visit from where cycles of like
    #: length would have it.
    visit_tolerance_cycles: float = 0.15

    # load_search
    #: Independent residuals of a manoeuvre: a start of three seconds, whose residuals are alike
    #: over 0.2 s. What a fit leaves while the machine cruises tells little of its mass.
    independent_residuals: int = 15
    #: Akaike criterion per manoeuvre by which loads must be more likely than a single load on
    #: uneven ground: 0.1 of an empty machine, 0.6 to 29 in seven logs of ten with loads.
    min_criterion_gain_of_loads: float = 0.25


#: The values in use.
LIMITS: Final = LoadLimits()
