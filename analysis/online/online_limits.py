"""Built-in limits of weighing on board, which no machine file can set."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class OnlineLimits:
    """Built-in limits of weighing on board, which no machine file can set.

    One section per file; a comment says what a value limits, in which unit, and how it was chosen.
    """

    # answer_progress
    #: Manoeuvres of scatter that a manoeuvre's own deviation counts for. In simulated logs it is
    #: right to a hundredth, and what is said of starts to come is the steadier the more it counts;
    #: on a machine it takes residuals for white, so that manoeuvres must be able to correct it.
    own_u_degrees_of_freedom: float = 10.0
    #: Deviations from the mean from which a manoeuvre is of another load.
    other_load_std: float = 5.0
    #: Standard uncertainty that is aimed at unless the caller says otherwise, as a fraction of the
    #: empty mass: it tells a full bucket of a loader from a half full one.
    target_u_1: float = 0.02

    # follower
    #: Changes of direction that are kept: a manoeuvre's mass comes before as many more.
    max_directions: int = 16
    #: Rows of which the windows are judged at once: more cost less each, and are known together.
    rows_stepped_at_once: int = 32

    # growing_log
    #: Time in s that every topic spans before rates and stamps are judged: two hundred samples at
    #: 100 Hz, and less than a window.
    head_s: float = 2.0
    #: Time in s of the samples kept before the last row: gaps end, and slow channels have
    #: neighbours.
    kept_s: float = 2.0
    #: Time in s of old samples that are dropped at once, as dropping costs more than keeping them.
    dropped_s: float = 0.25
    #: Cycles of the low-pass' cut-off after which nothing is left of where it began: 1e-40 of it.
    kept_low_pass_cycles: float = 40.0
    #: Samples of a topic that are kept, however slow it is.
    kept_min_samples: int = 8

    # online_report
    #: Standard uncertainty, as a fraction of the mass, above which a mass tells no load: a full
    #: bucket of a skid-steer loader is a third of the machine.
    certain_mass_u_1: float = 0.1
    #: Smallest mass of a loaded machine over the empty one,
    min_over_empty_1: float = 0.5
    #: and the largest.
    max_over_empty_1: float = 4.0
    #: Time in s for which a mass counts as that of the machine now, unless the caller says
    #: otherwise.
    valid_s: float = 120.0

    # rehearsal
    #: Rows after the first whole window of a rehearsal: more than those after which a recursion is
    #: fed.
    rehearsed_rows: int = 64
    #: Mass in kg and friction in N·s/m of the machine that is rehearsed; spins take the same loops.
    rehearsed_parameters: tuple[float, float] = (3000.0, 2000.0)
    #: Its acceleration, in m/s².
    rehearsed_acc_m_s2: float = 1.0


#: The values in use.
LIMITS: Final = OnlineLimits()
