"""Whether a machine file that `explain --apply` mended gives the mass back.

    python -P benchmarks/mended.py [--seeds 16] [--first 1300000] [--faults NAME …] [--minutes 60]
                                   [--json FILE] [--read FILE] [--write]

A log is simulated twice, without a fault and with one of the size that bends the mass by ten
standard deviations (the answer's or the paper's pooled one, whichever more; or of the size 3, where
size bends no mass), written as a bag, and mended by what it shows, as the command does it. `--json`
keeps every log as a line, `--read` makes the table of them, `--write` puts it into
docs/explaining.md.
"""

import tempfile
import time
import traceback
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np
import typer

from analysis.simulation import SimulatedLog
from benchmarks.findings_rows import OPEN, POOLED, found, replayed, simulated
from benchmarks.findings_trials import BY_NAME, base, errors, tried
from benchmarks.kept_trials import keep, read_rows
from benchmarks.page import markdown, put
from estimators.errors import PayscopeError
from replay.explain.proposal_edits import Proposal, insert_proposals_into_machine_file
from replay.explain.try_proposals import MachineText, write_corrected_machine_file
from replay.logs import open_log
from replay.machines.machine_file import (
    find_machine_file_or_shipped_one,
    find_time_axis_of_machine,
    load_machine,
)
from replay.pipeline import run
from replay.simulation.simulate_logs import write_logs_and_truths
from tests.trials.drawn_designs import Sections, join_designs
from tests.trials.fault_injection import Fault

FAULTS: Final = (
    "force late",
    "speed late",
    "force of the wrong sign",
    "left torque of the wrong sign",
    "accelerometer of the wrong sign",
    "sides swapped",
    "wheels larger",
    "IMU tilted",
    "IMU turned",
    "slope, no gravity",
    "acceleration in g",
    "speed in km/h",
)
#: The mended r.m.s. error over the clean one may be this.
MOST: Final = 1.5
_DEVIATIONS: Final = 10.0
_AS_SAID: Final = 3.0
_NEAR: Final = 1.35
_ROUNDS: Final = 4
#: Axes of the IMU that the shipped machine file has no channel for, as `init` drafts them.
AXES: Final = {
    "specific_force_y_m_s2.topic": "/imu/data",
    "specific_force_y_m_s2.field": "linear_acceleration.y",
    "specific_force_z_m_s2.topic": "/imu/data",
    "specific_force_z_m_s2.field": "linear_acceleration.z",
    "roll_rate_rad_s.topic": "/imu/data",
    "roll_rate_rad_s.field": "angular_velocity.x",
    "pitch_rate_rad_s.topic": "/imu/data",
    "pitch_rate_rad_s.field": "angular_velocity.y",
    "pitch_rad.topic": "/imu/data",
    "pitch_rad.derive": "pitch(orientation)",
}


@dataclass(frozen=True)
class MendedTrial:
    """One log with a fault, and what became of it.

    Attributes:
        fault: its name.
        seed: of design and noise.
        size: of the fault.
        bent: by how many standard deviations it bends the mass.
        true_kg: the mass.
        clean_kg: what the log without the fault says.
        faulty_kg: with it.
        mended_kg: with the mended machine file; as `faulty_kg` where nothing was mended.
        weighs: whether the verdict gives the mass, of the log with the fault and of the mended one.
        changes: cause, key and value of each change.
        taken_back: cause of each proposal that was tried and left out, and why.
        left: causes that the log then still shows.
    """

    fault: str
    seed: int
    size: float
    bent: float
    true_kg: float
    clean_kg: float | None
    faulty_kg: float | None
    mended_kg: float | None
    weighs: tuple[bool, bool]
    changes: tuple[tuple[str, str, Any], ...]
    taken_back: tuple[tuple[str, str], ...]
    left: tuple[str, ...]


def trial_of(fault: Fault, seed: int) -> MendedTrial | None:
    """A fault in one design, mended; None where the log without it has no answer."""
    sections, size, bent = _sized(fault, seed)
    return None if size is None else trial(fault, sections, size, bent=bent)


def trial(
    fault: Fault,
    sections: Sections,
    size: float,
    axes: Mapping[str, str] = AXES,
    bent: float = np.nan,
) -> MendedTrial:
    """A fault of a size in a design, mended with a machine file that has these axes of the IMU."""
    with tempfile.TemporaryDirectory(prefix="payscope-") as name:
        folder = Path(name)
        (straight,) = simulated(sections, [])
        (faulty,) = simulated(sections, [(fault, size)])
        file = folder / "machine.toml"
        file.write_text(_machine_text(straight, axes), encoding="utf-8")
        bags = {"clean": folder / "clean.bag", "faulty": folder / "faulty.bag"}
        write_logs_and_truths([straight, faulty], list(bags.values()))
        machine = load_machine(file, (POOLED, *fault.overrides))
        with open_log(bags["faulty"], time=find_time_axis_of_machine(machine)) as log:
            before = run(log, machine)
        output = folder / "mended.toml"
        source = MachineText(file, (POOLED, *fault.overrides))
        outcome = write_corrected_machine_file(bags["faulty"], source, before, (output, False))
        last = output if output.is_file() else file
        return MendedTrial(
            fault=fault.name,
            seed=sections["sensors"]["seed"],
            size=size,
            bent=bent,
            true_kg=straight.scenario.machine.mass_kg,
            clean_kg=_mass_kg(bags["clean"], file, fault.overrides),
            faulty_kg=_mass_kg(bags["faulty"], file, fault.overrides),
            mended_kg=_mass_kg(bags["faulty"], last, fault.overrides),
            weighs=(outcome.before.verdict.can_weigh, outcome.after.verdict.can_weigh),
            changes=tuple((each.cause, each.key, each.value) for each in outcome.changes),
            taken_back=tuple((each.proposal.cause, each.why) for each in outcome.rejected),
            left=tuple(each.cause for each in outcome.remaining),
        )


def _sized(fault: Fault, seed: int) -> tuple[Sections, float | None, float]:
    """The design, the size of the fault, and by how many deviations that bends the mass."""
    sections, size = base(seed, [fault]), _AS_SAID
    if fault.ground is not None:
        sections = join_designs(sections, fault.ground(sections, size))
    without = found(replayed(sections, (), overrides=fault.overrides))
    if without.mass_kg is None or not without.u_random_kg:
        return sections, None, np.nan
    bent = np.nan
    for number in range(_ROUNDS):
        of = tried(sections, [(fault, size)])
        bent = np.nan if of is None else errors(without, of)
        if fault.largest is None or number == _ROUNDS - 1:
            break
        factor = 0.5 if of is None else np.clip(_DEVIATIONS / max(bent, 0.02), 0.1, 6.0)
        wanted = float(np.clip(size * factor, 1e-3, fault.largest))
        if of is not None and (1.0 / _NEAR < factor < _NEAR or wanted == size):
            break
        size = wanted
    return sections, size, float(bent)


def _machine_text(log: SimulatedLog, axes: Mapping[str, str]) -> str:
    """The shipped machine file with the simulated machine, and further axes of its IMU."""
    body = log.scenario.machine
    stated = {
        "machine.empty_mass_kg": body.mass_kg,
        "machine.force_share": body.force_share,
        **{f"channels.{key}": value for key, value in axes.items()},
    }
    shipped = find_machine_file_or_shipped_one(Path("cat262c.toml"))
    changes = [Proposal(key, value, "", "simulated") for key, value in stated.items()]
    return insert_proposals_into_machine_file(shipped.read_text(encoding="utf-8"), changes, shipped)


def _mass_kg(bag: Path, file: Path, overrides: Sequence[str]) -> float | None:
    """The answer's mass whatever the verdict is."""
    machine = load_machine(file, (POOLED, *OPEN, *overrides))
    try:
        with open_log(bag, time=find_time_axis_of_machine(machine)) as log:
            return run(log, machine).frames["loads"].row(0, named=True)["mass_kg"]
    except PayscopeError:
        return None


def rms(errors_1: Sequence[float]) -> float:
    """Root mean square; NaN of none."""
    return float(np.sqrt(np.mean(np.square(errors_1)))) if errors_1 else np.nan


def table(trials: Sequence[MendedTrial]) -> str:
    """A row a fault: r.m.s. errors over the logs, each over those that have that mass."""
    head = [
        "fault",
        "logs",
        "without it",
        "with it",
        "mended",
        "mended / without",
        "given by the verdict: with it, mended",
    ]
    rows: list[list[str]] = []
    for fault in FAULTS:
        mine = [each for each in trials if each.fault == fault]
        if not mine:
            continue
        clean, faulty, after = (
            rms([(kg - each.true_kg) / each.true_kg for each, kg in of])
            for of in (
                [(each, each.clean_kg) for each in mine if each.clean_kg is not None],
                [(each, each.faulty_kg) for each in mine if each.faulty_kg is not None],
                [(each, each.mended_kg) for each in mine if each.mended_kg is not None],
            )
        )
        weigh = [sum(each.weighs[number] for each in mine) for number in (0, 1)]
        lost = sum(each.mended_kg is None for each in mine)
        said = f"{after / clean:.2f}" + (f" ({lost} without a mass)" if lost else "")
        mute = sum(each.faulty_kg is None for each in mine)
        rows.append(
            [
                fault,
                str(len(mine)),
                f"{clean:.2%}",
                "no mass" if mute == len(mine) else f"{faulty:.2%}",
                f"{after:.2%}",
                said if after <= MOST * clean and not lost else f"**{said}**",
                f"{weigh[0]}, {weigh[1]} of {len(mine)}",
            ]
        )
    return markdown(head, rows)


def measured(
    names: Sequence[str], seeds: int, first: int, minutes: float
) -> Iterator[MendedTrial | str]:
    """Seed by seed, so that whatever is done is done of all faults alike."""
    began = time.monotonic()
    for seed in range(first, first + seeds):
        for name in names:
            if time.monotonic() - began > 60.0 * minutes:
                return
            try:
                made = trial_of(BY_NAME[name], seed)
            except (PayscopeError, ArithmeticError, LookupError, ValueError):
                yield f"{name}, seed {seed}: {traceback.format_exc()[-900:]}"
            else:
                if made is not None:
                    yield made


def main(
    seeds: int = 16,
    first: int = 1_300_000,
    faults: Annotated[list[str] | None, typer.Option()] = None,
    minutes: float = 600.0,
    kept: Annotated[Path | None, typer.Option("--json")] = None,
    read: Annotated[list[Path] | None, typer.Option("--read")] = None,
    write: bool = False,
) -> None:
    trials = [MendedTrial(**row) for row in read_rows(*(read or []))]
    for each in () if read else measured(faults or FAULTS, seeds, first, minutes):
        if isinstance(each, str):
            print(each)
            continue
        trials.append(each)
        keep(kept, each)
    text = table(trials)
    print(text)
    if write:
        put("explaining.md", "mended", text)


if __name__ == "__main__":
    typer.run(main)
