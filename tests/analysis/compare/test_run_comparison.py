"""What differs between two replays, and nothing else."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import polars as pl
import pytest

from analysis.compare.run_comparison import Comparison, compare_runs
from analysis.model.run_record import InputFile, Provenance, Run
from analysis.model.schema import PHASE

GATE = pl.DataFrame(
    {
        "t_ns": [0, 10, 20, 30],
        "mi_x_nat": [None, 0.5, 0.9, -0.0],
        "accepted_x": [False, False, True, True],
    }
)
MASSES = pl.DataFrame(
    {"method": ["ls", "rls"], "mass_kg": [100.0, 50.0], "mass_std_kg": [1.0, 10.0]}
)
SEGMENTS = pl.DataFrame(
    {
        "start_t_ns": [0, 10_000_000_000],
        "end_t_ns": [5_000_000_000, 15_000_000_000],
        "phase": pl.Series(["accelerating", "braking"], dtype=PHASE),
        "mass_kg": [100.0, 104.0],
        "mass_std_kg": [1.0, 2.0],
    }
)


@dataclass(frozen=True, slots=True)
class InMemory:
    """A run as a replay to compare."""

    run: Run

    @property
    def provenance(self) -> Provenance:
        """Where its frames came from."""
        return self.run.provenance

    @property
    def stages(self) -> Mapping[str, Sequence[str]]:
        """The columns of each frame, in order."""
        return {name: frame.columns for name, frame in self.run.frames.items()}

    def read(self, stage: str, columns: Sequence[str]) -> pl.DataFrame:
        """Some columns of a frame."""
        return self.run.frames[stage].select(columns)


def run(frames: dict[str, pl.DataFrame] | None = None, **about: object) -> Run:
    frames = {"gate": GATE, "segments": SEGMENTS, "masses": MASSES} if frames is None else frames
    inputs = (InputFile(name="a.bag", sha256="aa", size_bytes=1),)
    return Run(frames, Provenance(inputs=inputs).model_copy(update=about))


def held(a: Run, b: Run, **words: float) -> Comparison:
    return compare_runs(InMemory(a), InMemory(b), **words)  # pyright: ignore


def changed(name: str, frame: pl.DataFrame) -> Run:
    return run({**run().frames, name: frame})


def test_a_run_equals_itself_and_says_how_much_was_compared():
    found = held(run(), run())
    assert found.is_equal
    assert found.columns == GATE.width + MASSES.width + SEGMENTS.width
    assert found.stages == found.estimates == found.manoeuvres == ()


def test_a_bit_of_a_zero_a_null_and_a_flag_each_count_once():
    other = GATE.with_columns(
        pl.Series("mi_x_nat", [1.5, 0.5, 0.9, 0.0]),
        pl.Series("accepted_x", [False, True, True, True]),
    )
    (stage,) = held(run(), changed("gate", other)).stages
    index, accepted = stage.columns
    assert (index.rows, index.only_a, index.only_b) == (2, 0, 1)
    assert (accepted.rows, accepted.largest, accepted.at_s) == (1, None, 1e-8)


def test_the_largest_change_has_its_sign_and_its_time():
    other = GATE.with_columns(pl.Series("mi_x_nat", [None, 0.6, 0.4, -0.0]))
    (stage,) = held(run(), changed("gate", other)).stages
    (index,) = stage.columns
    assert index.largest == pytest.approx(-0.5)
    assert index.largest_relative == pytest.approx(0.5 / 0.9)
    assert index.at_s == 2e-8


@pytest.mark.parametrize(
    ("relative_tolerance", "equal"), [(0.0, False), (1e-7, False), (1e-5, True)]
)
def test_rtol_is_of_the_larger_of_both_and_forgives_no_null(relative_tolerance: float, equal: bool):
    nudged = GATE.with_columns(pl.col("mi_x_nat") * (1 + 1e-6))
    assert (
        held(run(), changed("gate", nudged), relative_tolerance=relative_tolerance).is_equal
        == equal
    )
    holed = GATE.with_columns(pl.Series("mi_x_nat", [None, None, 0.9, -0.0]))
    assert not held(run(), changed("gate", holed), relative_tolerance=relative_tolerance).is_equal


def test_rows_correspond_by_time_also_where_the_runs_begin_at_other_times():
    later = run({"gate": GATE[1:].with_columns(t_ns=pl.col("t_ns") - 10)}, t0_unix_ns=10)
    found = held(run({"gate": GATE}), later)
    (stage,) = found.stages
    assert (stage.rows_a, stage.rows_b, stage.common, stage.columns) == (4, 3, 3, ())
    assert [each.name for each in found.provenance] == ["first aligned sample, unix ns"]


def test_a_column_or_stage_that_one_lacks_and_another_dtype_are_named():
    other = GATE.drop("accepted_x").with_columns(pl.col("mi_x_nat").cast(pl.Float32))
    found = held(run(), run({"gate": other, "extra": MASSES}))
    (stage,) = found.stages
    assert {column.name: column.fault for column in stage.columns} == {
        "accepted_x": "only in A",
        "mi_x_nat": "Float64 in A, Float32 in B",
    }
    assert (found.only_a, found.only_b) == (("segments", "masses"), ("extra",))


def test_estimates_are_sorted_by_how_far_they_moved_in_their_own_deviation():
    other = MASSES.with_columns(pl.Series("mass_kg", [103.0, 60.0]))
    found = held(run(), changed("masses", other))
    assert [(each.about, each.value_change, each.change_in_stds) for each in found.estimates] == [
        ("ls", 3.0, 3.0),
        ("rls", 10.0, 1.0),
    ]
    gone = MASSES.with_columns(pl.Series("mass_kg", [103.0, None]))
    found = held(run(), changed("masses", gone))
    assert [(each.about, each.value_change) for each in found.estimates] == [
        ("rls", None),
        ("ls", 3.0),
    ]


def test_manoeuvres_meet_by_their_time_and_what_one_lacks_is_none():
    moved = SEGMENTS.with_columns(
        start_t_ns=pl.col("start_t_ns") + 500_000_000, mass_kg=pl.col("mass_kg") + 1.0
    )
    split = pl.concat([moved, moved[:1].with_columns(pl.lit(10**11).alias("start_t_ns"))])
    split = split.with_columns(
        end_t_ns=pl.when(pl.col("start_t_ns") == 10**11).then(2 * 10**11).otherwise("end_t_ns")
    )
    found = held(run(), changed("segments", split)).manoeuvres
    assert [(each.about, each.a, each.b) for each in found] == [
        ("100.00 to 200.00 s", None, 101.0),
        ("0.00 to 5.00 s", 100.0, 101.0),
        ("10.00 to 15.00 s", 104.0, 105.0),
    ]


def test_versions_and_names_of_files_are_told_but_make_no_difference():
    renamed = (InputFile(name="b.bag", sha256="aa", size_bytes=1),)
    found = held(run(), run(inputs=renamed, versions={"numpy": "9"}))
    assert found.is_equal
    assert [each.name for each in (*found.inputs, *found.versions)] == ["names", "numpy"]


def test_frames_are_read_some_columns_at_a_time():
    asked: list[tuple[str, int]] = []

    class Watched(InMemory):
        def read(self, stage, columns):  # pyright: ignore
            asked.append((stage, len(columns)))
            return super().read(stage, columns)

    rows = 3_000_000
    long = pl.DataFrame(
        {
            "t_ns": pl.int_range(rows, eager=True),
            **{f"c{i}": pl.zeros(rows, eager=True) for i in range(12)},
        }
    )
    replays = [Watched(run({"gate": long})) for _ in range(2)]
    assert compare_runs(*replays).is_equal
    assert max(columns for _, columns in asked) <= 5
