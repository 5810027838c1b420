"""Whether a friction that drifts by 10 % in a week is dated within its interval, on simulated logs.

    python -P benchmarks/friction_week.py [--hours 0.25] [--seed 1] [--keep FOLDER]

A shift a day (`examples/shift.toml`), each reviewed by itself; the viscous
friction rises evenly by a tenth from the first to the last. The limit is 15 % above the first.
"""

import tempfile
from pathlib import Path
from typing import Final

import typer

from recordings.review.week_page import (
    describe_friction_trends,
    fit_friction_trends,
    format_day_number,
    read_shifts_of_reviews,
)
from replay.review.review_shift import ReviewOptions, review_shift
from replay.simulation.scenario_file import load_scenario_file
from replay.simulation.simulate_logs import simulate_scenario_to_logs

_EXAMPLES: Final = Path(__file__).resolve().parent.parent / "examples"
_DAYS: Final = 7
_DAY_S: Final = 86_400.0
_RISE: Final = 0.10
_LIMIT: Final = 0.15


def review_week(folder: Path, hours: float, seed: int) -> tuple[list[Path], float, float]:
    """Simulate and review the week.

    Returns:
        The folders of the reviews, the limit in N·s/m, and the true day at which it is reached, in
        days of unix time.
    """
    plain = load_scenario_file(_EXAMPLES / "shift.toml")
    base, begin_s = plain.machine.friction_N_s_m, plain.log.start_unix_s
    reviews: list[Path] = []
    for day in range(_DAYS):
        rise = 1.0 + _RISE * day / (_DAYS - 1)
        scenario = load_scenario_file(
            _EXAMPLES / "shift.toml",
            [
                f"shift.duration_h={hours}",
                "shift.logs=1",
                "shift.damaged_logs=0",
                f"machine.friction_N_s_m={base * rise}",
                f"log.start_unix_s={begin_s + day * _DAY_S}",
                f"sensors.seed={100 * seed + day}",
            ],
        )
        logs = simulate_scenario_to_logs(scenario, folder / f"day{day}.mcap", overwrites=True)
        made = review_shift(logs, _EXAMPLES / "yard.toml", folder / f"review{day}", ReviewOptions())
        value, std = made.state.friction
        print(f"day {day}: true {base * rise:,.0f}, fit {value:,.0f} ± {2.0 * (std or 0.0):,.0f}")
        reviews.append(made.folder)
    middle_d = (begin_s + 1800.0 * hours) / _DAY_S
    return reviews, base * (1.0 + _LIMIT), middle_d + (_DAYS - 1) * _LIMIT / _RISE


def main(hours: float = 0.25, seed: int = 1, keep: Path | None = None) -> None:
    """Date the limit, and say whether its interval holds the true day."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = keep or Path(scratch)
        folder.mkdir(exist_ok=True)
        reviews, limit, true_d = review_week(folder, hours, seed)
        trends = fit_friction_trends(read_shifts_of_reviews(reviews), limit)
    for sentence in describe_friction_trends(trends):
        print(sentence)
    for trend in trends.values():
        inside = trend.reached_d is not None and trend.reached_d[0] <= true_d <= trend.reached_d[1]
        print(f"true: {format_day_number(true_d)}; inside: {'yes' if inside else 'no'}")


if __name__ == "__main__":
    typer.run(main)
