"""Whether as many starts are missing as `follow` says: drawn simulated logs, followed to the end.

    python -P benchmarks/answer_progress.py [--logs 100] [--starts 12]

Each log has a load, a machine's noise and an aim of its own. At every manoeuvre the follower says
how many more starts the aim takes; the statement holds where it is reached after so many, one more
or one fewer. What the log is too short to tell is left out. The mass that is there then is compared
with the truth, which has the common part in it that is in no `load_u_kg`.
"""

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
import typer

from analysis.online.follower import Follower
from analysis.online.online_report import OnlineReport
from analysis.simulation import Scenario
from benchmarks.page import markdown
from replay import load_machine, open_log
from replay.inputs.channel_inputs import list_channel_fields
from replay.simulation.simulate_logs import simulate_scenario_to_logs

#: Standard uncertainties that are aimed at, in kg: a start of this machine has 6 to 9.
AIMS_KG = (2.2, 6.0)
EMPTY_KG = 3614.0
NOISE = ("force_N=60.0", "acc_m_s2=0.01", "speed_m_s=0.005")


class Statement(NamedTuple):
    """What was said at a manoeuvre, and what came.

    Attributes:
        after: starts until then.
        missing: more that it said.
        came: more until the aim was reached; None where it was not, in all of the log.
    """

    after: int
    missing: int
    came: int | None


def follow_drawn(seed: int, starts: int, folder: Path) -> tuple[list[Statement], float | None]:
    """The statements of a drawn log, and by how many deviations the mass is off at the aim."""
    dice = np.random.default_rng([seed, 35])
    load_kg = float(dice.uniform(0.0, 600.0))
    plan = Scenario.model_validate(
        {
            "campaign": {
                "loads_kg": [load_kg],
                "runs": starts,
                "standstill_s": float(dice.uniform(3.5, 5.0)),
                "throttle_force_N": float(dice.uniform(5000.0, 7500.0)),
            },
            "sensors": {"seed": seed},
        }
    )
    (path,) = simulate_scenario_to_logs(plan, folder / f"drawn_{seed}.mcap")
    noise = [
        f"settings.noise.{each}" for each in ("force_N=60", "acc_m_s2=0.01", "speed_m_s=0.005")
    ]
    machine = load_machine("cat262c.toml", noise)
    machine = machine.model_copy(
        update={"settings": machine.settings.copy_with_changes({"trace.methods": ("pooled",)})}
    )
    aim_kg = float(np.exp(dice.uniform(*np.log(AIMS_KG))))
    board = Follower(machine, until_u_kg=aim_kg)
    with open_log(path) as log:
        for topic, samples in log.read_many(list_channel_fields(board.log.machine)).items():
            board.append_samples(topic, samples)
    made = [each for each in board.advance(is_log_complete=True) if each.event == "manoeuvre"]
    path.unlink()
    return list(judge_statements(made)), deviations_off(made, EMPTY_KG + load_kg)


def judge_statements(made: list[OnlineReport]) -> Iterator[Statement]:
    """What was said at every manoeuvre before the aim was reached."""
    reached = next((k for k, each in enumerate(made, 1) if each.starts_missing == 0), None)
    for after, each in enumerate(made, 1):
        missing = each.starts_missing
        if not missing or (reached is not None and after >= reached):
            return
        if reached is not None:
            yield Statement(after, missing, reached - after)
        elif after + missing + 1 <= len(made):
            yield Statement(after, missing, None)


def deviations_off(made: list[OnlineReport], truth_kg: float) -> float | None:
    """By how many of its deviations the mass is off where the aim is reached."""
    there = next((each for each in made if each.starts_missing == 0), None)
    if there is None or there.load_mass_kg is None or there.load_u_kg is None:
        return None
    return (there.load_mass_kg - truth_kg) / there.load_u_kg


def holds(said: Statement) -> bool:
    return said.came is not None and abs(said.came - said.missing) <= 1


def main(logs: int = 100, starts: int = 12, first_seed: int = 0) -> None:
    found: list[Statement] = []
    off: list[float] = []
    with TemporaryDirectory() as name:
        for seed in range(first_seed, first_seed + logs):
            statements, deviation = follow_drawn(seed, starts, Path(name))
            found += statements
            off += [] if deviation is None else [deviation]
    rows: list[list[str]] = []
    groups = {"all": (1, 99), "1 missing": (1, 1), "2 or 3": (2, 3), "4 or more": (4, 99)}
    for title, (least, most) in groups.items():
        among = [each for each in found if least <= each.missing <= most]
        share = f"{100 * np.mean([*map(holds, among)]):.0f} %" if among else "–"
        rows.append([title, str(len(among)), share])
    print(markdown(["starts said to be missing", "statements", "there after n ± 1"], rows))
    print(
        f"\n{logs} logs; the aim reached in {len(off)}, the mass then within 2 u of the truth in "
        f"{100 * np.mean(np.abs(off) <= 2.0):.0f} %, within 3 u in "
        f"{100 * np.mean(np.abs(off) <= 3.0):.0f} %"
    )


if __name__ == "__main__":
    typer.run(main)
