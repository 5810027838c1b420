"""The campaign of tables that no machine would record, in small; and what it drives."""

import inspect
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from hypothesis import HealthCheck, Phase, given, settings, strategies

from benchmarks.degenerate_tables import (
    JOBS,
    SLOW_EVERY,
    SLOW_JOBS,
    WITHOUT_LOG,
    Driven,
    Job,
    applied,
    calibrated,
    disagreements,
    drafted,
    drive,
    explained,
    jobs_of,
    replayed,
    told,
)
from benchmarks.drawn_tables import DrawnTable, draw
from replay.commands.cli import app
from tests.replay.kept_replays import kept_replays
from tests.replay.sledge import MACHINE, sledge

#: Tables of the small campaign, some seconds each, and of the slow one.
TABLES, MANY_TABLES = 1, 60


@pytest.fixture(autouse=True)
def whatever_is_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whether loops are compiled already, and that is said, depends on the tests before."""
    from replay.commands import progress_bar

    monkeypatch.setattr(progress_bar, "LONG_S", float("inf"))


@pytest.fixture(scope="module", autouse=True)
def one_replay_of_a_table() -> Iterator[None]:
    """Commands are driven with a table one after the other; the first replays it."""
    with kept_replays():
        yield


def examples(count: int) -> settings:
    """So many examples; a smaller seed draws no smaller table."""
    unlike = [HealthCheck.too_slow, HealthCheck.function_scoped_fixture]
    phases = [Phase.explicit, Phase.generate]
    return settings(max_examples=count, phases=phases, suppress_health_check=unlike)


# but for the tables of which a viewer and an engine are started
@pytest.mark.heavy
@examples(TABLES)
@given(seed=strategies.integers(0, 10**9).filter(lambda seed: seed % SLOW_EVERY))
def test_a_drawn_table_ends_no_command_in_a_traceback_or_a_warning(seed: int) -> None:
    _, faults, ran = drive(seed)
    assert not faults, "\n".join(faults)
    assert ran["run"]


@pytest.mark.slow
@examples(MANY_TABLES)
@given(seed=strategies.integers(0, 10**9))
def test_nor_do_many(seed: int) -> None:
    _, faults, _ = drive(seed)
    assert not faults, "\n".join(faults)


def test_a_seed_draws_the_same_table_again(tmp_path: Path) -> None:
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
    one, other = (draw(5, tmp_path / folder) for folder in ("a", "b"))
    assert one.log.read_bytes() == other.log.read_bytes()
    assert one.machine.read_text() == other.machine.read_text()


def commands() -> set[str]:
    found = {str(each.name) for each in app.registered_commands}
    for group in app.registered_groups:
        if group.name not in WITHOUT_LOG:
            assert group.typer_instance is not None
            inside = group.typer_instance.registered_commands
            found |= {f"{group.name} {each.name}" for each in inside}
    return found | {str(group.name) for group in app.registered_groups} & WITHOUT_LOG


def test_every_command_that_reads_a_log_or_what_was_made_of_one_has_a_job() -> None:
    """Small twin of the next, which runs them."""
    source = "".join(map(inspect.getsource, (*JOBS, *SLOW_JOBS, replayed)))
    for name in commands() - WITHOUT_LOG:
        assert all(f'"{word}"' in source for word in name.split()), name


@pytest.mark.slow
def test_every_command_that_reads_a_log_or_what_was_made_of_one_is_driven(tmp_path: Path) -> None:
    log, machine = tmp_path / "sledge.csv", tmp_path / "sledge.toml"
    sledge(seconds=20.0).write_csv(log)
    machine.write_text(MACHINE)
    payscope = Driven(tmp_path)
    table = DrawnTable(0, log, machine, "nothing")
    made = replayed(table, payscope)
    assert made is not None
    assert made.status == 0
    for job in (*JOBS, *SLOW_JOBS):
        job(made, payscope)
    assert not payscope.faults, "\n".join(payscope.faults)
    assert commands() - WITHOUT_LOG == set(payscope.ran)


def test_every_pair_of_jobs_comes_in_turn() -> None:
    pairs = len(JOBS) * (len(JOBS) - 1)
    assert len({jobs_of(seed) for seed in range(pairs)}) == pairs


SPARSE = "a sample in a million seconds"
CASES = {
    "a force of zero": sledge().with_columns(force_N=pl.lit(0.0)),
    "no column that changes": sledge().with_columns(
        force_N=pl.lit(1.0), speed_m_s=pl.lit(1.0), acc_m_s2=pl.lit(1.0)
    ),
    "a mass of 1e12 kg": sledge(mass_kg=1e12),
    "a mass of 1e-12 kg": sledge().with_columns(force_N=1e-12 * pl.col("acc_m_s2")),
    "starts of 0, 0 and 99 kg": sledge(seconds=30.0).with_columns(
        force_N=pl.when(pl.col("time_s") < 20.0).then(0.0).otherwise(99.0) * pl.col("acc_m_s2")
    ),
    "a spike of 1e300": sledge().with_columns(
        speed_m_s=pl.when(pl.int_range(pl.len()) == 700).then(1e300).otherwise("speed_m_s")
    ),
    "numbers that have no square": sledge().with_columns(force_N=pl.col("force_N") * 1e-310),
    "one row": sledge().head(1),
    "two rows": sledge().head(2),
    "one stamp": sledge().with_columns(time_s=pl.lit(3.0)),
    SPARSE: sledge().with_columns(time_s=pl.col("time_s") * 1e8),
    "one start": sledge(seconds=10.0),
}


@pytest.mark.heavy
@pytest.mark.parametrize(
    "case",
    # holes of most of a day are looked at for ten seconds
    [pytest.param(each, marks=[pytest.mark.slow] * (each == SPARSE)) for each in CASES],
)
def test_a_degenerate_table_is_weighed_or_refused_in_a_line(case: str, tmp_path: Path) -> None:
    log, machine = tmp_path / "drawn.parquet", tmp_path / "drawn.toml"
    CASES[case].write_parquet(log)
    machine.write_text(MACHINE)
    payscope = Driven(tmp_path)
    replayed(DrawnTable(0, log, machine, case), payscope)
    assert not payscope.faults, "\n".join(payscope.faults)
    assert payscope.ran == Counter(run=payscope.ran["run"])


#: Tables of the campaign that ended commands in a traceback or a warning.
ONCE_FAULTS: dict[str, tuple[int, Job]] = {
    "an accelerometer that feels no gravity": (2_000_291, told),
    "a first moment over a mass of zero": (2_000_318, told),
    "turns that do not tell all parameters": (2_001_018, told),
    "terms that are one but for rounding": (2_001_035, explained),
    "a speed whose noise has no square": (2_001_152, told),
    "pooled masses without a deviation": (2_001_826, told),
    "a part of the log without a force": (2_002_682, told),
    "effects that nothing determines": (2_002_051, told),
    "loads of which a fit says nothing": (2_002_776, told),
    "a proposal after which nothing is determined": (3_000_246, applied),
    "a comparison of wheels that does not tell all three": (21_682, calibrated),
}


@pytest.mark.parametrize("seed", [3_000_004, 3_000_118], ids=["no time", "a huge speed"])
def test_a_table_that_says_nothing_is_drafted(seed: int, tmp_path: Path) -> None:
    payscope = Driven(tmp_path)
    drafted(draw(seed, tmp_path), payscope)
    assert not payscope.faults, "\n".join(payscope.faults)


#: Some seconds and more, where the others take one each.
LONG = (
    "turns that do not tell all parameters",
    "a speed whose noise has no square",
    "pooled masses without a deviation",
    "loads of which a fit says nothing",
    "a comparison of wheels that does not tell all three",
)


@pytest.mark.heavy
@pytest.mark.parametrize(
    "case",
    [case for case in ONCE_FAULTS if case not in LONG]
    + [pytest.param(case, marks=pytest.mark.slow) for case in LONG],
)
def test_what_once_ended_in_a_fault_does_not(case: str, tmp_path: Path) -> None:
    seed, job = ONCE_FAULTS[case]
    payscope = Driven(tmp_path)
    made = replayed(draw(seed, tmp_path), payscope)
    assert made is not None
    job(made, payscope)
    assert not payscope.faults, "\n".join(payscope.faults)


@pytest.mark.heavy
def test_a_run_that_says_two_things_is_a_fault(tmp_path: Path) -> None:
    log, machine = tmp_path / "sledge.csv", tmp_path / "sledge.toml"
    sledge().write_csv(log)
    machine.write_text(MACHINE)
    payscope, recording = Driven(tmp_path), tmp_path / "sledge.rrd"
    status, said = payscope.json("run", log, "-m", machine, "-o", recording)
    _, text = payscope("run", log, "-m", machine)
    assert list(disagreements(status, said, recording, text)) == []
    assert list(disagreements(1, said, recording, text)) == [
        "can_weigh is True, exit status 0 is False"
    ]
    said["loads"] = [{**load, "mass_kg": None} for load in said["loads"]]
    assert list(disagreements(status, said, recording, f"{text}no mass: ")) == [
        "can_weigh is True, a load with a mass is False",
        "the text says 'no mass' beside 'can weigh'",
    ]


def test_what_python_would_print_is_a_fault(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    payscope = Driven(tmp_path)
    monkeypatch.setattr("benchmarks.degenerate_tables.payscope", lambda: np.float64(1.0) / 0.0)
    payscope("run")
    assert "RuntimeWarning: divide by zero" in payscope.faults[0]
    monkeypatch.setattr("benchmarks.degenerate_tables.payscope", lambda: 1 / 0)
    payscope("run")
    assert "ZeroDivisionError" in payscope.faults[1]
