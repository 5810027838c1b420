"""A review of which no cycle counts: one line on stderr, exit 1, and a page with the reason."""

import json
from pathlib import Path

import polars as pl
import pytest
from markupsafe import escape

from recordings.review.review_page import PAGE
from recordings.review.reviewer_verdicts import VERDICTS
from recordings.review.shift_ledger import PARQUET, make_ledger_frame
from tests.analysis.cycles.drawn import drawn_shift
from tests.analysis.cycles.test_cycles import found
from tests.replay.shift_review import verdict
from tests.replay.sledge import Payscope, Said, sledge
from tests.replay.sledge_shift import EMPTY_KG, PAYLOADS_KG, sledge_shift
from tests.twins import mark_heavy_after

LOADED_KG = EMPTY_KG + PAYLOADS_KG[0]
WITHHELD = ("--set", "settings.verdict.r_squared_min=1.0")
CANNOT = "No tonnes: these logs cannot weigh; failed: "


def later(mass_kg: float) -> pl.DataFrame:
    # a log whose noise is that of another is a copy
    return sledge(mass_kg=mass_kg, seed=8).with_columns(pl.col("time_s") + 100.0)


def resting() -> pl.DataFrame:
    return sledge().with_columns(pl.lit(0.0).alias(name) for name in ("speed_m_s", "force_N"))


CASES = {
    "one load": ([sledge()], (), "No tonnes: 4 usable starts, one load throughout"),
    "one load in two logs": (
        [sledge(mass_kg=EMPTY_KG), later(EMPTY_KG)],
        (),
        "No tonnes: 8 usable starts, one load throughout",
    ),
    "a load that is not dumped": (
        [sledge(mass_kg=EMPTY_KG), later(LOADED_KG)],
        (),
        "No tonnes: 1 cycle: the recording ends before the dump",
    ),
    "an empty machine of another mass": (
        [sledge_shift()],
        ("--set", "machine.empty_mass_kg=150.0"),
        f"{CANNOT}negative_payload: lightest load below the machine's empty mass",
    ),
    "no start": ([resting()], (), CANNOT),
    "starts withheld": ([sledge()], WITHHELD, f"{CANNOT}r_squared"),
    "loads withheld": (
        [sledge(mass_kg=EMPTY_KG), later(LOADED_KG)],
        WITHHELD,
        f"{CANNOT}r_squared",
    ),
}


def words(logs: list[pl.DataFrame], machine: Path) -> list[object]:
    """`review` of logs beside their machine file."""
    paths = [machine.with_name(f"log_{number}.csv") for number in range(len(logs))]
    for path, table in zip(paths, logs, strict=True):
        table.write_csv(path)
    return ["review", *paths, "-m", machine, "-o", machine.with_name("review")]


def said_on_stderr(said: Said) -> str:
    """The one line there."""
    assert said.status == 1, said
    assert said.err.count("\n") == 1, said.err
    return said.err.rstrip("\n")


@pytest.mark.heavy
@pytest.mark.parametrize("case", mark_heavy_after(1, CASES))
def test_it_is_one_line_exit_1_and_a_page_with_the_reason(
    payscope: Payscope, machine_file: Path, case: str
) -> None:
    logs, options, reason = CASES[case]
    said = payscope(*words(logs, machine_file), *options)
    line = said_on_stderr(said)
    assert line.startswith(reason)
    assert "± 0.000 t" not in said.out
    folder = machine_file.with_name("review")
    assert f">{escape(line)}</p>" in (folder / PAGE).read_text(encoding="utf-8")
    assert not pl.read_parquet(folder / PARQUET)["counted"].any()


@pytest.mark.heavy
def test_a_second_review_says_the_same_without_a_replay(
    payscope: Payscope, machine_file: Path
) -> None:
    review = words([sledge()], machine_file)
    first, second = payscope(*review), payscope(*review)
    assert said_on_stderr(second) == said_on_stderr(first)
    assert "not replayed" in second.out


@pytest.mark.heavy
def test_json_has_the_reason_beside_what_it_has_of_every_shift(
    payscope: Payscope, machine_file: Path
) -> None:
    said = payscope(*words([sledge()], machine_file), "--json")
    found = json.loads(said.out)
    assert f"No tonnes: {found['no_tonnes']}" == said_on_stderr(said)
    assert found["shift"]["cycles"] == 0


@pytest.mark.heavy
def test_a_target_of_no_load_is_no_judgement(payscope: Payscope, machine_file: Path) -> None:
    said = payscope(*words([sledge()], machine_file), "--target", "40")
    assert said_on_stderr(said).startswith("No tonnes: ")
    assert "10/10/20" not in said.out


@pytest.mark.heavy
def test_cycles_that_a_reviewer_rejects_are_the_reason(
    payscope: Payscope, machine_file: Path
) -> None:
    review = words([sledge_shift(PAYLOADS_KG[:1])], machine_file)
    assert payscope(*review).status == 0
    folder = machine_file.with_name("review")
    identity = pl.read_parquet(folder / PARQUET)["id"][0]
    (folder / VERDICTS).write_text(verdict(identity, "reject = true\n"), encoding="utf-8")
    line = said_on_stderr(payscope(*review))
    assert line == "No tonnes: 1 cycle: rejected by a reviewer"


def test_a_ledger_without_a_row_has_the_columns_of_one_with_rows() -> None:
    cycles = found(drawn_shift([700.0, 600.0]))
    assert (
        make_ledger_frame(cycles.clear(), 0, {}).schema == make_ledger_frame(cycles, 0, {}).schema
    )
