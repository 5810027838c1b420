"""Are the results of two checkouts the same, bit for bit? Exit status 1 when any frame differs.

    python -P benchmarks/same_frames.py OTHER [--this CHECKOUT] [--data FOLDER] [--only WORD]

Each checkout replays, with its own sources, environment (`CHECKOUT/.venv`) and machine files: every
log of the shared data that has a machine file, with several settings; the simulated logs of the
examples; the demo; the golden logs of this checkout; and `reproduce table1 fig2`. Frames are
compared by name, order, columns, dtypes, nulls and bits, files byte for byte, and the provenance
but for the names of the settings, which one checkout may nest by stage and the other not, and
former names of checks.
"""

import hashlib
import json
import os
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Final

import polars as pl
import typer

REPO: Final = Path(__file__).resolve().parent.parent
GOLDEN: Final = REPO / "tests/golden"
ALL_METHODS: Final = ["ls", "rls", "fgls", "tls", "rtls", "huber", "pooled"]


@dataclass(frozen=True)
class Case:
    """Something that both checkouts do: replay logs, or run a command that writes files."""

    name: str
    logs: tuple[str, ...] = ()
    machine: str = ""
    settings: dict[str, Any] = field(default_factory=dict)
    command: tuple[str, ...] = ()

    @property
    def folder(self) -> str:
        """Where its results lie."""
        return "".join(letter if letter.isalnum() else "_" for letter in self.name)


def cases(data: Path) -> Iterator[Case]:
    """Every case, in the order of the table; those made of a command's files follow it."""
    axis = [
        ("linear_axis.csv", "examples/linear_axis.toml"),
        ("linear_axis.bag", "examples/linear_axis_ros.toml"),
        ("linear_axis_ros2", "examples/linear_axis_ros.toml"),
    ]
    drives = ["husky_asphalt.bag", "husky_asphalt_ros2"]
    husky = [
        (log, f"examples/{machine}.toml")
        for log in drives
        for machine in ("husky_imu", "husky_wheels")
    ]
    everything = {"methods": ALL_METHODS, "directional_forgetting": True}
    variants: dict[str, dict[str, Any]] = {"": {}, "all methods": everything}
    braking = {"without braking": {"exclude_braking": True}}
    small_windows = {"short windows": {"window_samples": 100, "smooth_samples": 1, "causal": True}}
    gates = {
        "ksg": {"gate": "ksg", "window_samples": 100},
        "variance": {"gate": "variance", "rate_hz": 50.0, "coulomb": False},
    }
    for log, machine in axis:
        more = braking | small_windows | (gates if log.endswith(".csv") else {})
        yield from replays(data / "logs" / log, machine, variants | more)
    for log, machine in husky:
        with_braking = {"with braking": {"exclude_braking": False, "methods": ALL_METHODS}}
        yield from replays(data / "logs" / log, machine, variants | with_braking)
    loader = "replay/machines/cat262c.toml"
    for scenario, logs in {"planar": ["planar.mcap"], "inertia": ["inertia.mcap"]}.items():
        command = ("simulate", f"{{checkout}}/examples/{scenario}.toml", "-o", logs[0])
        made = Case(f"simulate {scenario}", command=command)
        yield made
        for log in logs:
            yield from replays(Path("{made}", made.folder, log), loader, variants)
    yield Case("demo", command=("demo", "-o", ".", "--seed", "1"))
    for log in sorted(golden for end in ("mcap", "csv") for golden in GOLDEN.glob(f"*.{end}")):
        own = log.with_name(f"{log.stem}.machine.toml")
        for case in replays(log, str(own) if own.exists() else loader, variants):
            yield replace(case, name=f"golden {case.name}")
    small = ("--trials", "20", "--campaigns", "2", "--format", "csv")
    yield Case("reproduce table1 fig2", command=("reproduce", "table1", "fig2", "-o", ".", *small))


def replays(log: Path, machine: str, variants: Mapping[str, dict[str, Any]]) -> Iterator[Case]:
    """One log with one machine file, a case for each choice of settings."""
    for words, settings in variants.items():
        name = " ".join(filter(None, (log.name, Path(machine).stem, words)))
        yield Case(name, (str(log),), machine, settings)


# What a checkout does, in its own process and with its own sources.


def work(checkout: Path, folder: Path, listed: Path) -> None:
    """Do every case in this process; a fault of one is its result."""
    sys.path.insert(0, str(checkout))
    asked = json.loads(listed.read_text())
    for each in asked["cases"]:
        case = Case(**each)
        into = folder / case.folder
        into.mkdir()
        try:
            if case.command:
                command(case, checkout, into)
            else:
                replay(case, checkout, folder, into, asked["moved"])
        except Exception as error:  # noqa: BLE001 any fault is what the other checkout is held against
            (into / "fault.txt").write_text(f"{type(error).__name__}: {error}")
        print(f"{checkout}: {case.name}", file=sys.stderr, flush=True)


def replay(case: Case, checkout: Path, folder: Path, into: Path, moved: Mapping[str, str]) -> None:
    """Replay a case's logs and write down its frames and provenance."""
    from analysis import Machine
    from replay import TimeAxis, open_log, run

    own = checkout / case.machine
    content = tomllib.loads((own if own.exists() else Path(case.machine)).read_text())
    content["settings"] = settled({**leaves(content.get("settings", {})), **case.settings}, moved)
    machine = Machine.model_validate(content)
    time = TimeAxis(machine.log.time, machine.log.time_unit) if machine.log.time else None
    with ExitStack() as stack:
        paths = [log.replace("{made}", str(folder)) for log in case.logs]
        opened = [stack.enter_context(open_log(path, time=time)) for path in paths]
        replayed = run(opened, machine)
    keep(replayed, into)


def command(case: Case, checkout: Path, into: Path) -> None:
    """Run a command of the checkout; frames of recordings it writes are written down as well."""
    from recordings import read_recording

    about = tomllib.loads((checkout / "pyproject.toml").read_text())
    module, _, function = about["project"]["scripts"]["payscope"].partition(":")
    start = f"import sys; sys.path.insert(0, {str(checkout)!r}); from {module} import {function}"
    words = [word.replace("{checkout}", str(checkout)) for word in case.command]
    left = subprocess.run(
        [sys.executable, "-P", "-c", f"{start}; {function}()", *words],
        cwd=into,
        capture_output=True,
        text=True,
        check=False,
    )
    if left.returncode > 1:
        raise RuntimeError(left.stderr)
    for recording in sorted(into.glob("*.rrd")):
        keep(read_recording(recording), into)


def keep(run: Any, into: Path) -> None:
    """Write a run's frames and its provenance."""
    for number, (name, frame) in enumerate(run.frames.items()):
        path = into / f"{number:02d} {name.replace('/', '∕')}.arrow"
        frame.write_ipc(path, compression="zstd")
    about = run.provenance.model_dump(mode="json")
    (into / "provenance.json").write_text(json.dumps(about, indent=1))


def leaves(section: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Settings by their dotted names."""
    found: dict[str, Any] = {}
    for name, value in section.items():
        if isinstance(value, dict):
            found |= leaves(value, f"{prefix}{name}.")
        else:
            found[prefix + name] = value
    return found


def settled(named: Mapping[str, Any], moved: Mapping[str, str]) -> dict[str, Any]:
    """Nest settings as this checkout has them, whatever it was that named them."""
    from analysis import Settings

    moved = {**moved, **{new: old for old, new in moved.items()}}
    known = leaves(Settings.model_validate({}).model_dump(mode="json"))
    tree: dict[str, Any] = {}
    for name, value in named.items():
        found = next((path for path in (name, moved.get(name, name)) if path in known), name)
        *stages, last = found.split(".")
        here = tree
        for stage in stages:
            here = here.setdefault(stage, {})
        here[last] = value
    return tree


# What is compared, in the process that was started.


def compared(mine: Path, theirs: Path) -> tuple[str, str, str]:
    """How many frames and files, how many are equal, and the first difference."""
    faults = [
        path.read_text() if path.exists() else ""
        for path in (mine / "fault.txt", theirs / "fault.txt")
    ]
    if any(faults):
        if faults[0] == faults[1]:
            return "–", "–", f"neither can: {faults[0]}"
        return "–", "–", f"fault: {faults[0] or 'none'} | {faults[1] or 'none'}"
    names = [
        sorted(map(str, (p.relative_to(side) for p in side.rglob("*") if p.is_file())))
        for side in (mine, theirs)
    ]
    names = [[name for name in side if compares(name)] for side in names]
    if names[0] != names[1]:
        odd = sorted(set(names[0]) ^ set(names[1])) or ["their order"]
        return str(len(names[0])), "–", f"only in one of them: {', '.join(odd)}"
    different = [
        f"{name.removesuffix('.arrow')}: {fault}"
        for name in names[0]
        if (fault := difference(mine / name, theirs / name)) is not None
    ]
    count = len(names[0])
    return str(count), str(count - len(different)), different[0] if different else ""


def compares(name: str) -> bool:
    """Whether a file is compared: neither what holds times and ids, nor a copied machine file."""
    return not name.endswith((".rrd", ".png", ".md", ".toml"))


def difference(mine: Path, theirs: Path) -> str | None:
    """Say where two files first differ, None where they do not."""
    if mine.suffix == ".arrow":
        from analysis.model.check_names import rename_stored_checks

        name = mine.stem.partition(" ")[2]
        frames = (rename_stored_checks(name, pl.read_ipc(path)) for path in (mine, theirs))
        return frame_difference(*frames)
    if mine.name == "provenance.json":
        return provenance_difference(*(json.loads(p.read_text()) for p in (mine, theirs)))
    hashes = [hashlib.sha256(path.read_bytes()).hexdigest() for path in (mine, theirs)]
    return None if hashes[0] == hashes[1] else "its bytes"


def frame_difference(mine: pl.DataFrame, theirs: pl.DataFrame) -> str | None:
    """Say where two frames first differ: columns, dtypes, height, then the first bit."""
    for name in mine.columns:
        if name not in theirs.columns:
            return f"column {name} is missing in the other"
    if mine.columns != theirs.columns:
        return f"columns {mine.columns} | {theirs.columns}"
    if mine.schema != theirs.schema:
        return f"dtypes {mine.schema} | {theirs.schema}"
    if mine.height != theirs.height:
        return f"{mine.height} rows | {theirs.height}"
    for name in mine.columns:
        unequal = bits(mine[name]).ne_missing(bits(theirs[name]))
        if unequal.any():
            row = unequal.arg_true()[0]
            values = f"{mine[name][row]!r} | {theirs[name][row]!r}"
            return f"{name} in {unequal.sum()} of {mine.height} rows, first in {row}: {values}"
    return None


def bits(series: pl.Series) -> pl.Series:
    """A column whose equal values are equal bits: 0.0 is not -0.0."""
    if not series.dtype.is_float():
        return series
    values = series.fill_null(0.0).to_numpy()
    whole = pl.Series(values.view(f"i{values.itemsize}"))
    return pl.select(pl.when(series.is_not_null()).then(whole)).to_series()


def provenance_difference(mine: dict[str, Any], theirs: dict[str, Any]) -> str | None:
    """Say where two provenances first differ, but for the names of settings and newer keys."""
    for key in mine:
        if key in ("settings", "fingerprint") or key not in theirs:
            continue
        if mine[key] != theirs[key]:
            return f"{key}: {mine[key]} | {theirs[key]}"
    values = [sorted(map(json.dumps, leaves(each["settings"]).values())) for each in (mine, theirs)]
    return None if values[0] == values[1] else "values of the settings"


def moved_settings() -> Mapping[str, str]:
    """The nested name of each setting that was flat once, as this checkout has it."""
    sys.path.insert(0, str(REPO))
    from replay.machines.old_names import OLD_NAMES

    return {
        old.removeprefix("settings."): new.removeprefix("settings.")
        for old, new in OLD_NAMES.items()
    }


def main(
    other: Annotated[Path, typer.Argument(help="The checkout to compare with.")],
    this: Annotated[Path, typer.Option(help="The checkout to compare: this one.")] = REPO,
    data: Annotated[Path | None, typer.Option(help="The folder of the shared data.")] = None,
    only: Annotated[str, typer.Option(help="Only cases whose name has this in it.")] = "",
) -> None:
    shared = [parent / "shared/data" for parent in REPO.parents]
    data = data or next((folder for folder in shared if folder.is_dir()), Path("shared/data"))
    listed = [case for case in cases(data) if only in case.name]
    made = {
        each.logs[0].split("/")[1]
        for each in listed
        if each.logs[:1] and each.logs[0].startswith("{made}")
    }
    listed = [case for case in cases(data) if case in listed or case.folder in made]
    with tempfile.TemporaryDirectory() as scratch:
        wanted = Path(scratch, "cases.json")
        asked = {"cases": [asdict(case) for case in listed], "moved": moved_settings()}
        wanted.write_text(json.dumps(asked))
        started: list[tuple[Path, subprocess.Popen[bytes]]] = []
        for number, checkout in enumerate((this.resolve(), other.resolve())):
            folder = Path(scratch, str(number))
            folder.mkdir()
            python = checkout / ".venv/bin/python"
            command = [python, "-P", Path(__file__), "--work", checkout, folder, wanted]
            # nothing of one checkout may be imported by the other
            clean = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
            clean["PYTHONDONTWRITEBYTECODE"] = "1"
            started.append((folder, subprocess.Popen(command, cwd=folder, env=clean)))
        for _, process in started:
            if process.wait():
                raise SystemExit("a checkout failed as a whole; see above")
        rows = [(case.name, *compared(*(f / case.folder for f, _ in started))) for case in listed]
    width = max((len(case.name) for case in listed), default=0)
    print(f"{'what':<{width}}  {'compared':>8} {'equal':>5}  first difference ({this} | {other})")
    for name, count, equal, first in rows:
        print(f"{name:<{width}}  {count:>8} {equal:>5}  {first}".rstrip())
    differ = sum(count != equal for _, count, equal, _ in rows)
    print(f"{len(rows)} cases, {differ} differ" if differ else f"{len(rows)} cases, all equal")
    raise typer.Exit(1 if differ or not rows else 0)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--work"]:
        work(*map(Path, sys.argv[2:5]))
    else:
        typer.run(main)
