"""Every command on tables that no machine would record: no traceback, no warning, one answer.

    python -P benchmarks/degenerate_tables.py [--tables 10000] [--processes 1]
                                             [--json degenerate_tables.jsonl]

`drawn_tables` draws the tables, each by its seed; those that the file of results has are not driven
again. Each table is replayed, and two of the other jobs are done with it, every pair in turn
(viewer and fleet, which are slow to start, of one in 250); `--every` does all of them. Commands
that read a recording read that one. Commands run in this process, as a user would type them.
What breaks a promise is printed and kept: an exception, a warning that Python would print, an exit
status that has no meaning, a message of several lines, JSON that is none, and a run whose headline,
`can_weigh`, exit status and recording do not agree.
"""

import json
import multiprocessing
import os
import resource
import shutil
import signal
import sys
import tempfile
import tomllib
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from functools import cache, partial
from pathlib import Path
from typing import Annotated, Any, Final

from benchmarks.kept_trials import keep, read_rows

os.environ.setdefault("POLARS_MAX_THREADS", "1")

import polars as pl
import typer

from analysis.model.answer import make_answer
from benchmarks.drawn_tables import DrawnTable, draw
from recordings import read_recording
from replay.commands import progress_bar
from replay.commands.cli import main as payscope

#: Exit statuses of a command that was told to end: so is the campaign.
_INTERRUPTED: Final = (128 + signal.SIGINT, 128 + signal.SIGTERM)
#: What Python does not print by itself.
_SILENT: Final = (DeprecationWarning, PendingDeprecationWarning, ImportWarning, ResourceWarning)
#: Address space of the process; a table has a few thousand rows.
_MOST_BYTES: Final = 8 << 30
#: Tables that a process drives before another takes its place.
_TABLES_A_PROCESS: Final = 50
#: Runs of a campaign, each with one mass and so much more of the force than the one before.
_RUNS: Final = 3
#: Of the stages of a recording so many are shown of one table, others of another.
_STAGES: Final = 6
_GROWS: Final = 0.2
_CAMPAIGN: Final = """
[campaign]
title = "drawn"
intended_use = "none"
author = "A. Author"
signer = "T. Signer"

[machine]
file = "{machine}"
id = "drawn-1"
empty_mass_kg = 100.0
empty_mass_u_kg = 0.5
"""
_MASS: Final = """
[[masses]]
id = "block-{number}"
value_kg = 20.0
u_kg = 0.02
certificate = "K-{number}"
expires = 2030-01-31
"""
_RUN: Final = """
[[runs]]
id = "run-{number}"
log = "{log}"
loads = {loads}
day = 2026-05-0{day}
operator = "O. Operator"
"""
_FLEET: Final = """
[fleet]
name = "drawn"

[[machines]]
name = "drawn"
logs = "*"
file = "{machine}"
"""


@dataclass(frozen=True)
class Replayed:
    """A table that `run` has replayed.

    Attributes:
        drawn: the table and its machine file.
        recording: of the run.
        status: exit status of the run.
        said: by the run with `--json`.
    """

    drawn: DrawnTable
    recording: Path
    status: int
    said: dict[str, Any]


Job = Callable[[Replayed, "Driven"], None]


@dataclass
class Driven:
    """A command line that types commands, and what broke a promise.

    Attributes:
        folder: where outputs go.
        faults: by command, a line or a traceback each.
        ran: how often each command ran.
    """

    folder: Path
    faults: list[str] = field(default_factory=list)
    ran: Counter[str] = field(default_factory=Counter)

    def __call__(self, *words: object, more: tuple[int, ...] = ()) -> tuple[int, str]:
        """Type a command; its exit status, and what it wrote to stdout.

        Args:
            words: of the command.
            more: exit statuses that have a meaning besides 0, 1 and 2.
        """
        typed = [str(word) for word in words]
        said = " ".join(typed).replace(str(self.folder), "")
        self.ran[" ".join(typed[:2]) if typed[0] == "fleet" else typed[0]] += 1
        out, err = self.folder / "stdout", self.folder / "stderr"
        status: object = None
        before = sys.argv
        sys.argv = ["payscope", *typed]
        with (
            _streams_to(self.folder / "libraries") as libraries,
            out.open("w", encoding="utf-8") as stdout,
            err.open("w", encoding="utf-8") as stderr,
            redirect_stdout(stdout),
            redirect_stderr(stderr),
            warnings.catch_warnings(record=True) as heard,
        ):
            warnings.simplefilter("always")
            try:
                payscope()
            except SystemExit as left:
                status = left.code
            except BaseException:  # noqa: BLE001 - that there is one is what is looked for
                self.faults.append(f"{said}: {traceback.format_exc()}")
        sys.argv = before
        if told := libraries.read_text(encoding="utf-8", errors="replace").strip():
            self.faults.append(f"{said}: a library wrote: {told[:200]}")
        for each in heard:
            if not issubclass(each.category, _SILENT):
                place = f"{each.filename}:{each.lineno}"
                self.faults.append(f"{said}: {each.category.__name__}: {each.message} ({place})")
        text, message = out.read_text(encoding="utf-8"), err.read_text(encoding="utf-8")
        if status in _INTERRUPTED:
            raise KeyboardInterrupt
        if status is not None and status not in (0, 1, 2, *more):
            self.faults.append(f"{said}: exit status {status}")
        if status == 2 and (text or message.count("\n") != 1):
            self.faults.append(f"{said}: exit status 2 with {text!r} and {message!r}")
        return (int(status) if isinstance(status, int) else -1), text

    def json(self, *words: object, more: tuple[int, ...] = ()) -> tuple[int, Any]:
        """Type a command that prints JSON; None where it was refused."""
        status, text = self(*words, "--json", more=more)
        if status not in (0, 1):
            return status, None
        try:
            return status, json.loads(text, parse_constant=_no_number)
        except ValueError as error:
            self.faults.append(f"{' '.join(map(str, words))}: {error} in {text[:200]!r}")
            return status, None

    def require(self, holds: bool, what: str) -> None:
        """Keep what does not hold."""
        if not holds:
            self.faults.append(what)


@contextmanager
def _streams_to(path: Path) -> Iterator[Path]:
    """Send what libraries write to the process' own stdout and stderr to a file."""
    kept = [os.dup(number) for number in (1, 2)]
    file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    for number in (1, 2):
        os.dup2(file, number)
    os.close(file)
    try:
        yield path
    finally:
        for number, own in enumerate(kept, start=1):
            os.dup2(own, number)
            os.close(own)


def _no_number(name: str) -> None:
    raise ValueError(f"{name} is no JSON")


def replayed(drawn: DrawnTable, payscope: Driven) -> Replayed | None:
    """`run`, whose JSON, exit status and recording agree; None where it is refused."""
    recording = payscope.folder / "drawn.rrd"
    status, said = payscope.json("run", drawn.log, "-m", drawn.machine, "-o", recording)
    if said is None or not recording.exists():
        return None
    for fault in disagreements(status, said, recording):
        payscope.require(False, f"run: {fault}")
    return Replayed(drawn, recording, status, said)


def disagreements(
    status: int, said: dict[str, Any], recording: Path, text: str | None = None
) -> Iterator[str]:
    """What of a run says that there is a mass, or that there is none, unlike the others.

    Args:
        status: of `run`.
        said: with `--json`.
        recording: of the run.
        text: without `--json`; None where it was not asked for.
    """
    can_weigh = said["verdict"]["can_weigh"]
    kept = make_answer(read_recording(recording))
    has_mass = any(load["mass_kg"] is not None for load in said["loads"])
    by_method = any(value is not None for value in said.get("mass_kg", {}).values())
    others = {
        "exit status 0": status == 0,
        "a load with a mass": has_mass,
        **({} if text is None else _by_text(text)),
        "the recording's verdict": kept.verdict.can_weigh,
        "the recording's mass": any(load["mass_kg"] is not None for load in kept.loads),
    }
    yield from (
        f"can_weigh is {can_weigh}, {what} is {holds}"
        for what, holds in others.items()
        if holds != can_weigh
    )
    if can_weigh and text is not None and "no mass: " in text:
        yield "the text says 'no mass' beside 'can weigh'"
    if by_method and not can_weigh:
        yield "a method has a mass that is withheld"


def _by_text(text: str) -> dict[str, bool]:
    return {
        "the text 'Log usable'": "Log usable: " in text,
        "no text 'not usable'": "Log not usable" not in text,
    }


def told(of: Replayed, payscope: Driven) -> None:
    """`run` in words: exit status and text agree with the JSON."""
    status, text = payscope("run", of.drawn.log, "-m", of.drawn.machine, "--goal", "5")
    payscope.require(of.status == status, f"run: exit status {of.status}, then {status}")
    for fault in disagreements(status, of.said, of.recording, text):
        payscope.require(False, f"run: {fault}")


def inspected(drawn: DrawnTable, payscope: Driven) -> None:
    """`info`, with and without `--check`."""
    payscope("info", drawn.log)
    payscope.json("info", drawn.log, "--check")


def drafted(drawn: DrawnTable, payscope: Driven) -> None:
    """`init`; the draft is a machine file that `run` takes or refuses in a line."""
    draft = payscope.folder / "draft.toml"
    status, _ = payscope("init", drawn.log, "-o", draft)
    if status == 0:
        payscope("run", drawn.log, "-m", draft)


def show(of: Replayed, payscope: Driven) -> None:
    """`show`: the stages, and some of them in each of its formats."""
    recording = of.recording
    status, text = payscope("show", recording, "--format", "json")
    stages = list(json.loads(text)) if status == 0 else []
    first = of.drawn.seed // len(JOBS) * _STAGES
    some = {(first + number) % len(stages): number for number in range(_STAGES)} if stages else {}
    for place, number in some.items():
        stage = stages[place]
        if number % 3 == 0:
            payscope("show", recording, stage, "--from", "0", "--to", "5")
        elif number % 3 == 1:
            payscope("show", recording, stage, "--format", "json")
        else:
            payscope("show", recording, stage, "--at", "1")


def plotted(of: Replayed, payscope: Driven) -> None:
    """`plot`."""
    payscope("plot", of.recording, "-o", payscope.folder / "drawn.png")


def explained(of: Replayed, payscope: Driven) -> None:
    """`explain`: of a recording, and at a second with a picture."""
    payscope.json("explain", of.recording)
    payscope("explain", of.recording, "--at", "3", "-o", payscope.folder / "explained.png")


def applied(of: Replayed, payscope: Driven) -> None:
    """`explain --apply`."""
    mended = payscope.folder / "mended.toml"
    payscope("explain", of.drawn.log, "-m", of.drawn.machine, "--apply", "-o", mended)


def compared(of: Replayed, payscope: Driven) -> None:
    """`compare` with a run of another setting."""
    other = payscope.folder / "other.rrd"
    words = ("--set", "settings.gate.threshold_nat=0.1", "-o", other)
    if payscope("run", of.drawn.log, "-m", of.drawn.machine, *words)[0] in (0, 1):
        payscope("compare", of.recording, other)
        payscope.json("compare", of.recording, other)


def swept(of: Replayed, payscope: Driven) -> None:
    """`sweep` with its figure."""
    over = ("--over", "settings.gate.threshold_nat=0.1,0.7", "--reference", "100")
    figure = payscope.folder / "swept.png"
    payscope("sweep", of.drawn.log, "-m", of.drawn.machine, *over, "--figure", figure)


def reviewed(of: Replayed, payscope: Driven) -> None:
    """`review`."""
    folder = payscope.folder / "review"
    payscope("review", of.drawn.log, "-m", of.drawn.machine, "-o", folder, "--target", "100")


def calibrated(of: Replayed, payscope: Driven) -> None:
    """`calibrate` with the table as every run, its force grown; `init --campaign`, `verify`."""
    drawn = of.drawn
    logs = payscope.folder / "logs"
    logs.mkdir()
    table = pl.read_csv(drawn.log) if drawn.log.suffix == ".csv" else pl.read_parquet(drawn.log)
    text = _CAMPAIGN.format(machine=drawn.machine)
    text += "".join(_MASS.format(number=number) for number in range(1, _RUNS))
    for number in range(_RUNS):
        log = logs / f"run-{number}.parquet"
        force = pl.selectors.matches("force|torque") * (1.0 + _GROWS * number)
        table.with_columns(force).write_parquet(log)
        loads = json.dumps([f"block-{each}" for each in range(1, number + 1)])
        text += _RUN.format(number=number, log=log, loads=loads, day=number + 1)
    campaign = payscope.folder / "campaign.toml"
    campaign.write_text(text, encoding="utf-8")
    evidence = payscope.folder / "evidence"
    payscope("calibrate", campaign, "-o", evidence)
    if evidence.exists():
        payscope("verify", evidence, more=(3, 4, 5, 6, 7, 8))
        payscope("run", drawn.log, "-m", drawn.machine, "--calibration", evidence)
    draft = payscope.folder / "draft_campaign.toml"
    payscope("init", "--campaign", logs, "-m", drawn.machine, "-o", draft)


def followed(of: Replayed, payscope: Driven) -> None:
    """`follow`: the table as a log that no longer grows."""
    words = ("-m", of.drawn.machine, "--json", "--idle-s", "0")
    payscope("follow", of.drawn.log, *words)


def queried(of: Replayed, payscope: Driven) -> None:
    """`query`: of the recording and of the table; `convert`, and the converted log once more."""
    payscope("query", of.recording, 'SELECT "check", value FROM verdict', "--format", "json")
    payscope("query", of.drawn.log, "--tables")
    folder = payscope.folder / "converted"
    payscope("convert", of.drawn.log, "-o", folder)
    if folder.exists():
        payscope("info", folder)


def migrated(of: Replayed, payscope: Driven) -> None:
    """`migrate`: under an old name of a key the log runs as before; the file is rewritten."""
    text = of.drawn.machine.read_text(encoding="utf-8")
    old = of.drawn.machine.with_name("old.toml")
    key = "[settings.forces]\nacceleration"
    old.write_text(text.replace(key, key.replace(".forces", "")), encoding="utf-8")
    status, _ = payscope("run", of.drawn.log, "-m", old)
    payscope.require(status == of.status, f"run: exit status {of.status}, by old names {status}")
    payscope("migrate", old)
    same = tomllib.loads(old.read_text(encoding="utf-8")) == tomllib.loads(text)
    payscope.require(same, "migrate: another machine file")


#: What is done with a table that was replayed, two of them at a time.
JOBS: Final[tuple[Job, ...]] = (
    told,
    lambda of, payscope: inspected(of.drawn, payscope),
    lambda of, payscope: drafted(of.drawn, payscope),
    show,
    plotted,
    explained,
    applied,
    compared,
    swept,
    reviewed,
    calibrated,
    queried,
    followed,
    migrated,
)


def viewed(of: Replayed, payscope: Driven) -> None:
    """`view`: a stretch of the recording, photographed where the machine has a driver for it."""
    words = ("--from", "0", "--to", "5", "--screenshot", payscope.folder / "shots")
    payscope("view", of.recording, *words, "--tab", "Overview")


def fleet(of: Replayed, payscope: Driven) -> None:
    """`fleet`: a folder with the table replayed on the engine, queried, reported, compared."""
    logs, results = payscope.folder / "fleet", payscope.folder / "results"
    logs.mkdir()
    shutil.copy(of.drawn.log, logs)
    described = payscope.folder / "fleet.toml"
    described.write_text(_FLEET.format(machine=of.drawn.machine), encoding="utf-8")
    start = ("fleet", "run", logs, "-m", described, "-o", results)
    payscope(*start, "--workers", "1", "--recordings")
    query = ("SELECT key, status, reason, can_weigh FROM results", "--format", "json")
    status, text = payscope("fleet", "query", results, *query)
    rows = json.loads(text) if status == 0 else []
    payscope.require(len(rows) == 1, f"fleet: {len(rows)} results of one log")
    for row in rows:
        payscope.require(row["status"] == "replayed", f"fleet: {row}")
        payscope("fleet", "open", results, row["key"], "-o", payscope.folder / "opened.rrd")
    payscope("fleet", "report", results, "-o", payscope.folder / "fleet.html")
    payscope("fleet", "compare", results, results)


#: What starts a viewer or an engine, which takes many seconds: of one table in so many.
SLOW_JOBS: Final = (viewed, fleet)
SLOW_EVERY: Final = 250
#: Commands that read no message of a log, and nothing that was made of one.
WITHOUT_LOG: Final = frozenset(
    {"demo", "excite", "keys", "notarise", "reproduce", "simulate", "warm-up"}
)


def jobs_of(seed: int) -> tuple[Job, ...]:
    """Two jobs; every pair comes in turn."""
    first, round_ = seed % len(JOBS), seed // len(JOBS)
    other = (first + 1 + round_ % (len(JOBS) - 1)) % len(JOBS)
    return JOBS[first], JOBS[other]


def drive(seed: int, *, every: bool = False) -> tuple[str, list[str], Counter[str]]:
    """Drive one table; what was drawn, what broke a promise, and how often each command ran."""
    with tempfile.TemporaryDirectory(prefix="drawn-") as name:
        folder = Path(name)
        drawn, payscope = draw(seed, folder), Driven(folder)
        made = replayed(drawn, payscope)
        if made is not None:
            jobs = JOBS if every else jobs_of(seed)
            slow = SLOW_JOBS if every or seed % SLOW_EVERY == 0 else ()
            for job in (*jobs, *slow):
                job(made, payscope)
        else:
            # its own machine file refuses it; a draft may not
            inspected(drawn, payscope)
            drafted(drawn, payscope)
        return drawn.spoilt, payscope.faults, payscope.ran


def _begin_process() -> None:
    # commands are made of their functions at every call, which takes a tenth of the time
    typer.main.get_command = cache(typer.main.get_command)
    # on a busy machine compiling is slow, which is told on stderr
    progress_bar.LONG_S = float("inf")
    # a table that takes all memory is a fault like others, not the end of the campaign
    resource.setrlimit(resource.RLIMIT_AS, (_MOST_BYTES, _MOST_BYTES))


def _row(seed: int, *, every: bool) -> dict[str, Any]:
    """What is kept of a table."""
    spoilt, faults, ran = drive(seed, every=every)
    return {"seed": seed, "spoilt": spoilt, "faults": faults, "ran": dict(ran)}


def main(
    tables: int = 10_000,
    first: int = 0,
    every: bool = False,
    processes: int = 1,
    results: Annotated[Path, typer.Option("--json")] = Path("degenerate_tables.jsonl"),
) -> None:
    done = {row["seed"] for row in read_rows(results)} if results.exists() else set[int]()
    broken = 0
    wanted = [seed for seed in range(first, first + tables) if seed not in done]
    # Rerun keeps threads of each recording that a process has written
    pool = multiprocessing.get_context("spawn").Pool(
        processes, _begin_process, maxtasksperchild=_TABLES_A_PROCESS
    )
    with pool:
        for row in pool.imap(partial(_row, every=every), wanted):
            keep(results, row)
            broken += bool(row["faults"])
            for fault in row["faults"]:
                print(f"seed {row['seed']} ({row['spoilt']}): {fault}", flush=True)
        pool.close()
        pool.join()
    ran = Counter[str]()
    rows = read_rows(results)
    for row in rows:
        ran.update(row["ran"])
    kept = sum(bool(row["faults"]) for row in rows)
    print(f"{len(rows)} tables, {kept} with a fault; {ran.total()} commands: {dict(ran)}")
    if broken:
        raise typer.Exit(1)


if __name__ == "__main__":
    typer.run(main)
