"""Faults put into a real log: what findings say of it, and what mending gives back.

    python -P benchmarks/real_faults.py LINEAR_AXIS.csv LINEAR_AXIS.bag [--write]

The log is the linear axis of the EMPS benchmark as a table (time_s, position_m, force_N), and as a
bag for what a table has not: header stamps and log times. `--write` puts the table into
docs/explaining.md.
"""

import struct
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import polars as pl
import typer
from rosbags.rosbag1 import Reader, Writer

from benchmarks.page import markdown, put
from estimators.errors import DataError
from recordings.report.finding_text import find_readable_cause_name, read_findings_of_run
from replay.explain.try_proposals import MachineText, write_corrected_machine_file
from replay.logs import open_log
from replay.machines.machine_file import find_time_axis_of_machine, load_machine
from replay.pipeline import run

REPO: Final = Path(__file__).resolve().parent.parent
_HZ: Final = 1000.0
_FORCE: Final = "force_N"
_POSITION: Final = "position_m"
#: Seconds and nanoseconds of a message's header, behind its number.
_STAMP: Final = struct.Struct("<II")
_STAMP_AT: Final = 4

Table = pl.DataFrame
Made = Callable[[Table, float, np.random.Generator], Table]


@dataclass(frozen=True)
class RealFault:
    """A fault of some sizes.

    Attributes:
        name: in tables; `{}` is the size.
        causes: keys of findings that name it.
        sizes: that are tried.
        made: the log with it, by the size; None: its header stamps jump by so many ms.
    """

    name: str
    causes: tuple[str, ...]
    sizes: tuple[float, ...]
    made: Made | None


@dataclass(frozen=True)
class RealTrial:
    """What became of a log with a fault.

    Attributes:
        what: the fault with its size.
        causes: keys that name it.
        named: of all findings in their order.
        mass_kg: of the answer; None where it is withheld.
        mended: what was changed in the machine file.
        mended_kg: of the answer with that; None where it is withheld.
    """

    what: str
    causes: tuple[str, ...]
    named: tuple[str, ...]
    mass_kg: float | None
    mended: tuple[str, ...]
    mended_kg: float | None

    @property
    def place(self) -> int | None:
        """Where the fault is named, from 1 on."""
        places = [number for number, each in enumerate(self.named, 1) if each in self.causes]
        return places[0] if places else None


def _times(column: str) -> Made:
    return lambda log, size, _: log.with_columns(pl.col(column) * size)


def _late(log: Table, size_ms: float, _: np.random.Generator) -> Table:
    return log.with_columns(pl.col(_FORCE).shift(round(size_ms * _HZ / 1e3)).backward_fill())


def _early(log: Table, size_ms: float, _: np.random.Generator) -> Table:
    return log.with_columns(pl.col(_FORCE).shift(-round(size_ms * _HZ / 1e3)).forward_fill())


def _spikes(log: Table, size_N: float, dice: np.random.Generator) -> Table:
    force = log[_FORCE].to_numpy().copy()
    rows = dice.choice(force.size, 40, replace=False)
    force[rows] += dice.choice([-size_N, size_N], rows.size)
    return log.with_columns(pl.Series(_FORCE, force))


def _spans(log: Table, span_s: float, dice: np.random.Generator) -> np.ndarray:
    """Whether a row is in one of three spans, (n,)."""
    t = log["time_s"].to_numpy()
    begins = (np.arange(3) + dice.uniform(0.1, 0.7, 3)) * t[-1] / 3.0
    return np.any([(t >= begin) & (t < begin + span_s) for begin in begins], axis=0)


def _frozen(log: Table, span_s: float, dice: np.random.Generator) -> Table:
    held = pl.Series(_spans(log, span_s, dice))
    first = held & ~held.shift(1, fill_value=False)
    kept = pl.when(held & ~first).then(None).otherwise(pl.col(_FORCE))
    return log.with_columns(kept.forward_fill().alias(_FORCE))


def _gaps(log: Table, span_s: float, dice: np.random.Generator) -> Table:
    return log.filter(~pl.Series(_spans(log, span_s, dice)))


def _clipped(log: Table, share: float, _: np.random.Generator) -> Table:
    most = float(log[_FORCE].abs().quantile(0.999) or 0.0) * share
    return log.with_columns(pl.col(_FORCE).clip(-most, most))


def _coarse(column: str) -> Made:
    return lambda log, step, _: log.with_columns((pl.col(column) / step).round() * step)


FAULTS: Final = (
    RealFault("nothing", (), (0.0,), lambda log, _, __: log),
    RealFault("force times {:g}", ("sign_flipped",), (-1.0,), _times(_FORCE)),
    RealFault("position times {:g}", ("sign_flipped",), (-1.0,), _times(_POSITION)),
    RealFault("force {:g} ms late", ("delay",), (5.0, 10.0, 20.0, 40.0), _late),
    RealFault("force {:g} ms early", ("delay",), (5.0, 10.0, 20.0, 40.0), _early),
    RealFault("force times {:g}", ("wrong_unit",), (0.001, 1 / 4.4482216), _times(_FORCE)),
    RealFault("position times {:g}", ("wrong_unit",), (1000.0,), _times(_POSITION)),
    RealFault("40 spikes of {:g} N", ("spikes",), (50.0, 200.0), _spikes),
    RealFault("force frozen, 3 times {:g} s", ("frozen",), (0.5, 1.0), _frozen),
    RealFault("force clipped at {:.0%}", ("saturated",), (0.9, 0.7), _clipped),
    RealFault("3 gaps of {:g} s", ("gaps",), (0.2, 1.0), _gaps),
    RealFault("force in steps of {:g} N", ("quantised",), (10.0, 40.0), _coarse(_FORCE)),
    RealFault("position in steps of {:g} m", ("quantised",), (1e-4, 1e-3), _coarse(_POSITION)),
    RealFault("clock jumps by {:g} ms", ("clock_jump",), (20.0, 200.0), None),
)


def trial(fault: RealFault, size: float, table: Path, bag: Path, seed: int = 1) -> RealTrial:
    """A fault of a size in the log, and the machine file mended by what is found.

    Args:
        fault: what is put in.
        size: of it.
        table: the log as `time_s`, `position_m`, `force_N`.
        bag: the same as a ROS 1 bag, for header stamps.
        seed: of what is drawn.
    """
    dice = np.random.default_rng([seed, 20_268])
    with tempfile.TemporaryDirectory(prefix="payscope-") as name:
        if fault.made is None:
            log, file = Path(name) / "axis.bag", REPO / "examples/linear_axis_ros.toml"
            _jumped(bag, size, log)
        else:
            log, file = Path(name) / "axis.csv", REPO / "examples/linear_axis.toml"
            fault.made(pl.read_csv(table), size, dice).write_csv(log)
        machine = load_machine(file)
        with open_log(log, time=find_time_axis_of_machine(machine)) as opened:
            before = run(opened, machine)
        output = Path(name) / "mended.toml"
        after = write_corrected_machine_file(log, MachineText(file), before, (output, False))
    return RealTrial(
        fault.name.format(size),
        fault.causes,
        tuple(each.cause for each in read_findings_of_run(before)),
        _mass_kg(before.frames["loads"].to_dicts()),
        tuple(f"{each.key} = {each.value}" for each in after.changes),
        _mass_kg(after.after.loads),
    )


def _mass_kg(loads: Sequence[dict[str, object]]) -> float | None:
    masses = [row["mass_kg"] for row in loads if not row["withheld"]]
    return masses[0] if len(masses) == 1 and isinstance(masses[0], float) else None


def _jumped(bag: Path, size_ms: float, output: Path) -> None:
    """The bag with header stamps that jump half-way."""
    with Reader(bag) as reader, Writer(output) as writer:
        connections = {
            each.id: writer.add_connection(
                each.topic, each.msgtype, msgdef=each.msgdef.data, md5sum=each.digest
            )
            for each in reader.connections
        }
        half_ns = (reader.start_time + reader.end_time) // 2
        for connection, log_time_ns, raw in reader.messages():
            data = bytearray(raw)
            if log_time_ns >= half_ns:
                s, ns = _STAMP.unpack_from(data, _STAMP_AT)
                jumped = divmod(s * 10**9 + ns + round(size_ms * 1e6), 10**9)
                _STAMP.pack_into(data, _STAMP_AT, *jumped)
            writer.write(connections[connection.id], log_time_ns, bytes(data))


def table_of(trials: Sequence[RealTrial]) -> str:
    """A row a fault and size."""
    head = ["put into the log", "mass", "named", "changed by `--apply`", "mass then"]
    rows = [
        [
            each.what,
            _kg(each.mass_kg),
            ", ".join(
                f"**{find_readable_cause_name(name)}**"
                if name in each.causes
                else find_readable_cause_name(name)
                for name in each.named
            )
            or "no cause",
            ", ".join(f"`{change}`" for change in each.mended) or "–",
            _kg(each.mended_kg) if each.mended else "–",
        ]
        for each in trials
    ]
    return markdown(head, rows)


def _kg(mass_kg: float | None) -> str:
    return "withheld" if mass_kg is None else f"{mass_kg:.2f} kg"


def main(table: Path, bag: Path, write: bool = False) -> None:
    trials: list[RealTrial] = []
    for fault in FAULTS:
        for size in fault.sizes:
            try:
                trials.append(trial(fault, size, table, bag))
            except DataError as error:
                print(f"{fault.name.format(size)}: {error}")
    text = table_of(trials)
    print(text)
    if write:
        put("explaining.md", "real faults", text)


if __name__ == "__main__":
    typer.run(main)
