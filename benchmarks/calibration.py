"""How often intervals of calibrated masses hold, over campaigns at run level.

    python -P benchmarks/calibration.py [--campaigns 20000] [--trials 4000] [--seed 13] [--write]
    python -P benchmarks/calibration.py --whole 24 [--seed 13] [--write]

Draws what runs say instead of logs, and not as the fit assumes: repeatability differs from run to
run, runs scatter with heavier tails than the normal, and every deviation that is stated (of a
reading, of a reference, of a day) is wrong by 10 %. `--write` puts the tables into
docs/calibrating.md. `--whole` simulates, replays and calibrates so many campaigns as logs instead.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import typer
from scipy.stats import t as student_t

from analysis.calibration.line.line_fit import fit_line_and_test_lack_of_fit
from analysis.calibration.line.line_inversion import LineInversion
from analysis.calibration.line.line_model import RunMeans
from analysis.calibration.line.point_errors import fit_error_slope_and_offset_kg
from analysis.calibration.line.variance_components import WithinRunVariance
from analysis.paper import printed_numbers
from analysis.paper.torque_chain import TorqueChain
from benchmarks.page import markdown, put
from benchmarks.whole_campaigns import whole as whole_campaigns

CONFIDENCE: Final = 0.95
#: Deviations are stated with so much of error,
STATED_U: Final = 0.1
#: repeatability differs so much from run to run (of its logarithm),
UNEVEN: Final = 0.2
#: and the scatter of runs has the tails of Student's t with so many degrees of freedom.
TAILS: Final = 8.0
NORMAL: Final = 1.96
#: One trial of the paper by pooled least squares scatters so, in kg of calibrated mass.
TRIAL_KG: Final = 38.0
#: What turns the torque chain's offset into mass, so that beta is 3330 kg.
EFFECTIVE_ACC: Final = 1.763


@dataclass(frozen=True)
class Plan:
    """A campaign and its machine; deviations in kg of m̂, references in kg."""

    days: int
    runs: int = 1
    readings: tuple[int, int] = (3, 9)
    repeatability_kg: float = 20.0
    run_kg: float = 8.0
    day_kg: float = 10.0
    references: str = "equal"
    day_known: bool = False
    same_day: bool = False
    loads: int = 6


def covariance(plan: Plan) -> np.ndarray:
    """(loads, loads) of the references, as stated."""
    if plan.references == "equal":
        return np.eye(plan.loads) * 2.0**2
    if plan.references == "unequal":
        return np.diag(np.linspace(0.5, 8.0, plan.loads) ** 2)
    # drums weighed on one scale, one after the other loaded
    drums = np.arange(plan.loads)
    return 3.0**2 + np.minimum.outer(drums, drums) * 1.0**2 + np.outer(drums, drums) * 1.0**2


@dataclass(frozen=True)
class Drawn:
    """Points of a campaign, and a later run: its mass, what it says, of how many readings, ± u."""

    points: RunMeans
    day_known_kg: float | None
    mass_kg: float
    y_kg: float
    readings: int
    u_random_kg: float


def drawn(dice: np.random.Generator, plan: Plan) -> Drawn:
    """Draw a machine, a campaign and a later run."""
    stated = covariance(plan)
    wrong = np.exp(dice.normal(0.0, STATED_U, plan.loads))
    true = dice.multivariate_normal(np.zeros(plan.loads), stated, method="cholesky") * wrong
    reference_kg = 3614.0 + np.linspace(0.0, 250.0, plan.loads)
    c1 = dice.normal(1.0, 0.05)
    c0 = dice.normal(0.0, 100.0)
    loads, days, _ = (x.ravel() for x in np.indices((plan.loads, plan.days, plan.runs)))
    count = loads.size
    readings = dice.integers(plan.readings[0], plan.readings[1] + 1, count + 1)
    own_kg = plan.repeatability_kg * np.exp(dice.normal(0.0, UNEVEN, count + 1))
    scatter = dice.standard_t(TAILS, count + 1) * plan.run_kg / np.sqrt(TAILS / (TAILS - 2.0))
    day_kg = dice.normal(0.0, plan.day_kg, plan.days + 1)
    if plan.same_day:
        day_kg[-1] = day_kg[0]
    mass_kg = dice.uniform(reference_kg[0], reference_kg[-1])
    x = np.append((reference_kg + true)[loads], mass_kg)
    mean_kg = c0 + c1 * x + np.append(day_kg[days], day_kg[-1]) + scatter
    mean_kg = mean_kg + dice.normal(0.0, own_kg / np.sqrt(readings))
    squares = float((own_kg[:-1] ** 2 * dice.chisquare(readings[:-1] - 1)).sum())
    points = RunMeans(
        y_kg=mean_kg[:-1],
        readings=readings[:-1],
        load=loads,
        day=days,
        reference_kg=reference_kg,
        covariance_kg2=stated,
        within=WithinRunVariance(squares, int((readings[:-1] - 1).sum())),
    )
    said_kg = own_kg[-1] / np.sqrt(readings[-1]) * np.exp(dice.normal(0.0, STATED_U))
    known_kg = plan.day_kg * float(np.exp(dice.normal(0.0, STATED_U))) if plan.day_known else None
    return Drawn(points, known_kg, mass_kg, mean_kg[-1], int(readings[-1]), float(said_kg))


def of_19(x: np.ndarray, y: np.ndarray) -> tuple[float, float, float, float]:
    """Slope and offset of (19), and their textbook deviations."""
    line = fit_error_slope_and_offset_kg(x, y)
    assert line is not None
    alpha, beta = line
    left = y - alpha * x - beta
    s = np.sqrt(left @ left / (x.size - 2))
    return alpha, beta, s / np.sqrt(((x - x.mean()) ** 2).sum()), s


def holds_19(one: Drawn) -> tuple[bool, bool]:
    """Whether (19) on load means holds the later mass: its prediction interval, ± u(m̂) alone."""
    points = one.points
    loads = np.unique(points.load)
    x = np.array([points.y_kg[points.load == load].mean() for load in loads])
    alpha, beta, u_alpha, s = of_19(x, points.reference_kg[loads])
    error = abs(alpha * one.y_kg + beta - one.mass_kg)
    spread = np.hypot(s * np.sqrt(1.0 + 1.0 / x.size), (one.y_kg - x.mean()) * u_alpha)
    factor = student_t.ppf(0.5 + CONFIDENCE / 2.0, x.size - 2)
    return bool(error <= factor * spread), bool(error <= NORMAL * abs(alpha) * one.u_random_kg)


def outcome(one: Drawn) -> np.ndarray:
    """Whether each interval holds the later mass, and half of ours in kg.

    Ours with the run's own uncertainty, without it; (19)'s; u(m̂) alone.
    """
    line, _ = fit_line_and_test_lack_of_fit(one.points, one.day_known_kg)
    found = LineInversion.from_line(line).invert_mass_estimates(
        np.full(2, one.y_kg),
        np.full(2, float(one.readings)),
        np.array([one.u_random_kg, np.nan]),
        CONFIDENCE,
    )
    held = (found.low_kg <= one.mass_kg) & (one.mass_kg <= found.high_kg)
    half = (found.high_kg[1] - found.low_kg[1]) / 2.0
    return np.array([*held, *holds_19(one), half])


def outcomes(plan: Plan, campaigns: int, seed: int) -> np.ndarray:
    """(campaigns, outcomes) of one plan."""
    dice = np.random.default_rng(seed)
    return np.array([outcome(drawn(dice, plan)) for _ in range(campaigns)])


def percent(held: np.ndarray) -> list[str]:
    return [f"{100.0 * share:.1f} %" for share in held.mean(axis=0)]


def masses(campaigns: int, seed: int) -> Iterator[list[str]]:
    """A row a plan."""
    for (name, references), plan in PLANS.items():
        found = outcomes(replace(plan, references=references), campaigns, seed)
        row = [name, references, *percent(found[:, :4]), f"{np.median(found[:, 4]):.0f}"]
        print(", ".join(row), flush=True)
        yield row


#: Six loads in each; a day of 10 kg beside 20 kg a reading and 8 kg a run, but where said.
PLANS: Final = {
    ("one day, its deviation known, a run a load", "equal"): Plan(1, day_known=True),
    ("one day, its deviation known, two runs a load", "unequal"): Plan(1, 2, day_known=True),
    ("5 days", "equal"): Plan(5),
    ("5 days", "unequal"): Plan(5),
    ("5 days", "shared"): Plan(5),
    ("4 days", "unequal"): Plan(4),
    ("3 days", "equal"): Plan(3),
    ("2 days of 25 kg", "shared"): Plan(2, day_kg=25.0),
    ("one day, nothing known, mass of another day", "equal"): Plan(1, 2),
}


@dataclass(frozen=True)
class PaperRuns:
    """The paper's campaign, six loads of nine runs, through the torque chain that explains it.

    Attributes:
        singles: as 54 runs of a reading.
        together: as six runs of nine readings.
        line: true c0 and c1.
        y_kg: (54,) m̂.
        reference_kg: (54,) what was believed to be on board.
    """

    singles: RunMeans
    together: RunMeans
    line: tuple[float, float]
    y_kg: np.ndarray
    reference_kg: np.ndarray


def papers(dice: np.random.Generator) -> PaperRuns:
    """Draw the paper's campaign."""
    chain = TorqueChain()
    loads, each = 6, 9
    # the front axle carries more with each drum than the drum: in m̂ a line of this slope
    c1 = chain.gain_1 * chain.load_lever_1
    empty_kg = printed_numbers.MASS_KG
    at_empty_kg = chain.gain_1 * chain.empty_fraction_1 * empty_kg + chain.offset_N / EFFECTIVE_ACC
    c0 = at_empty_kg - c1 * empty_kg
    reference_kg = empty_kg + np.linspace(0.0, printed_numbers.LOAD_RANGE_KG, loads)
    stated = np.zeros((loads, loads))
    drums = np.arange(1, loads)
    # drums on one scale: its error is in each, its reading noise in each alone
    stated[1:, 1:] = 0.2**2 * np.outer(drums, drums) + 0.1**2 * np.minimum.outer(drums, drums)
    error = np.zeros(loads)
    error[1:] = dice.multivariate_normal(np.zeros(loads - 1), stated[1:, 1:])
    load = np.repeat(np.arange(loads), each)
    own_kg = TRIAL_KG * c1 * np.exp(dice.normal(0.0, UNEVEN, load.size))
    y_kg = c0 + c1 * (reference_kg + error)[load] + dice.normal(0.0, own_kg)
    by_load = y_kg.reshape(loads, each)
    squares = float(((by_load - by_load.mean(axis=1, keepdims=True)) ** 2).sum())
    day = np.zeros(load.size, np.int64)
    ones = np.ones(load.size, np.int64)
    singles = RunMeans(y_kg, ones, load, day, reference_kg, stated, WithinRunVariance(0.0, 0))
    together = RunMeans(
        by_load.mean(axis=1), np.full(loads, each), np.arange(loads), day[:loads],
        reference_kg, stated, WithinRunVariance(squares, loads * (each - 1)),
    )  # fmt: skip
    return PaperRuns(singles, together, (c0, c1), y_kg, reference_kg[load])


def ours(points: RunMeans, line: tuple[float, float]) -> tuple[float, float, float, float]:
    """Whether the intervals hold alpha and beta, and what they are over the truth."""
    fitted, _ = fit_line_and_test_lack_of_fit(points, None)
    inversion = LineInversion.from_line(fitted)
    c0, c1 = line
    low, high = inversion.compute_slope_interval(CONFIDENCE)
    at_zero = inversion.invert_with_line_uncertainty_only(0.0, CONFIDENCE)
    beta_kg = -c0 / c1
    found_kg = float(at_zero.mass_kg[0])
    holds_beta = at_zero.low_kg[0] <= beta_kg <= at_zero.high_kg[0]
    return float(low <= c1 <= high), float(holds_beta), c1 / fitted.slope_1, found_kg / beta_kg


def by_19(
    x: np.ndarray, y: np.ndarray, line: tuple[float, float]
) -> tuple[float, float, float, float]:
    """The same by least squares of (19) and its textbook intervals."""
    alpha, beta, u_alpha, s = of_19(x, y)
    factor = student_t.ppf(0.5 + CONFIDENCE / 2.0, x.size - 2)
    u_beta = np.hypot(s / np.sqrt(x.size), x.mean() * u_alpha)
    c0, c1 = line
    return (
        float(abs(alpha - 1.0 / c1) <= factor * u_alpha),
        float(abs(beta + c0 / c1) <= factor * u_beta),
        alpha * c1,
        -beta * c1 / c0,
    )


def paper_outcomes(campaigns: int, seed: int) -> dict[str, np.ndarray]:
    """(campaigns, 4) by each way to fit the paper's campaign."""
    dice = np.random.default_rng(seed)
    found: dict[str, list[tuple[float, float, float, float]]] = {}
    for _ in range(campaigns):
        one = papers(dice)
        means = (x.reshape(6, 9).mean(axis=1) for x in (one.y_kg, one.reference_kg))
        for name, row in {
            "54 runs of one reading": ours(one.singles, one.line),
            "six runs of nine readings": ours(one.together, one.line),
            "(19) on six load means": by_19(*means, one.line),
            "(19) on 54 single runs": by_19(one.y_kg, one.reference_kg, one.line),
        }.items():
            found.setdefault(name, []).append(row)
    return {name: np.array(rows) for name, rows in found.items()}


def alphas(campaigns: int, seed: int) -> Iterator[list[str]]:
    """A row a way to fit the paper's campaign."""
    for name, found in paper_outcomes(campaigns, seed).items():
        over = [f"{value:.3f}" for value in found[:, 2:].mean(axis=0)]
        yield [name, *percent(found[:, :2]), *over]


def main(
    campaigns: int = 20_000,
    trials: int = 4_000,
    whole: int = 0,
    seed: int = 13,
    write: bool = False,
) -> None:
    if whole:
        heads = ["priors", "masses", "held", "± kg", "r.m.s. error kg", "error / u", "score"]
        tables = {"whole logs": markdown([*heads, "refused"], list(whole_campaigns(whole, seed)))}
    else:
        tables = run_level(campaigns, trials, seed)
    for name, table in tables.items():
        print(table, flush=True)
        if write:
            put("calibrating.md", name, table)


def run_level(campaigns: int, trials: int, seed: int) -> dict[str, str]:
    """The tables of campaigns at run level."""
    return {
        "calibrated masses": markdown(
            ["campaign", "references", "ours", "ours, no u(m̂)", "(19)", "u(m̂) alone", "± kg"],
            list(masses(campaigns, seed)),
        ),
        "the paper's campaign": markdown(
            ["fit", "α held", "β held", "α / truth", "β / truth"], list(alphas(trials, seed))
        ),
    }


if __name__ == "__main__":
    typer.run(main)
