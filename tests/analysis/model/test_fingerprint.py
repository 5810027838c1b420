"""A fingerprint changes with every bit of a run, and with nothing else."""

import polars as pl
import pytest

from analysis.model.fingerprint import digest_frame, make_run_fingerprint
from analysis.model.run_record import InputFile, Provenance, Run
from analysis.model.settings import Settings

FRAME = pl.DataFrame(
    {
        "t_ns": [0, 10, 20, 30],
        "force_x_N": [1.0, None, -0.5, float("nan")],
        "gap": [False, True, None, False],
        "phase": pl.Series(["braking", None, "arc", "arc"], dtype=pl.Enum(["arc", "braking"])),
        "meaning": ["a", "", None, "Größe"],
        "count": pl.Series([1, 2, None, 255], dtype=pl.UInt8),
    }
)


def cell(column: str, row: int, value: object) -> pl.DataFrame:
    """The frame with another value in one place."""
    values = FRAME[column].to_list()
    values[row] = value
    return FRAME.with_columns(pl.Series(column, values, dtype=FRAME.schema[column]))


def test_a_frame_made_alike_has_the_same_digest():
    assert digest_frame(FRAME) == digest_frame(FRAME.clone())
    assert digest_frame(pl.DataFrame()) == digest_frame(pl.DataFrame())


@pytest.mark.parametrize(
    "other",
    [
        cell("force_x_N", 0, 1.0 + 2.0**-52),
        cell("force_x_N", 1, 0.0),
        cell("force_x_N", 1, float("nan")),
        cell("t_ns", 3, 31),
        cell("gap", 2, False),
        cell("gap", 3, True),
        cell("phase", 0, "arc"),
        cell("phase", 0, None),
        cell("meaning", 1, None),
        cell("meaning", 3, "Grösse"),
        cell("count", 3, 254),
        FRAME.with_columns(pl.Series("meaning", ["", "a", None, "Größe"])),
        FRAME.with_columns(pl.col("phase").cast(pl.Enum(["arc", "braking", "spinning"]))),
        FRAME.with_columns(pl.col("phase").cast(pl.String)),
        FRAME.with_columns(pl.col("count").cast(pl.UInt16)),
        FRAME.rename({"gap": "hole"}),
        FRAME.select(reversed(FRAME.columns)),
        FRAME.drop("gap"),
        FRAME[:3],
        FRAME.with_columns(pl.col("t_ns").cast(pl.Float64)),
    ],
)
def test_any_change_makes_another_digest(other: pl.DataFrame):
    assert digest_frame(other) != digest_frame(FRAME)


def test_a_zero_is_not_a_negative_zero():
    digests = {digest_frame(pl.DataFrame({"force_x_N": [zero]})) for zero in (0.0, -0.0)}
    assert len(digests) == 2


def test_where_one_text_ends_and_the_next_begins_counts():
    digests = {digest_frame(pl.DataFrame({"name": names})) for names in (["ab", "c"], ["a", "bc"])}
    assert len(digests) == 2


def test_chunks_and_what_lies_below_a_null_do_not_count():
    chunked = pl.concat([FRAME[:1], FRAME[1:2], FRAME[2:]], rechunk=False)
    assert chunked["t_ns"].n_chunks() == 3
    assert digest_frame(chunked) == digest_frame(FRAME)
    read = pl.DataFrame(pl.from_arrow(FRAME.to_arrow()))
    assert digest_frame(read.cast(dict(FRAME.schema))) == digest_frame(FRAME)
    assert digest_frame(pl.concat([FRAME, FRAME])[4:]) == digest_frame(FRAME)
    mask = pl.Series([True, False, True, True])
    hidden = [
        pl.DataFrame({"x": values}).select(pl.when(mask).then("x").alias("x"))
        for values in ([1.0, 2.0, 3.0, 4.0], [1.0, 9.0, 3.0, 4.0])
    ]
    assert digest_frame(hidden[0]) == digest_frame(hidden[1])


def test_rows_beyond_those_hashed_together_count():
    long = pl.DataFrame({"t_ns": pl.int_range(1_100_003, eager=True)})
    other = long.with_columns(pl.when(pl.col("t_ns") == 1_100_001).then(0).otherwise("t_ns"))
    assert digest_frame(long) != digest_frame(other)
    holed = long.with_columns(pl.when(pl.col("t_ns") != 1_100_001).then("t_ns"))
    chunked = pl.concat([holed[:777_777], holed[777_777:]], rechunk=False)
    assert digest_frame(chunked) == digest_frame(holed)


def test_values_that_no_recording_holds_count_as_well():
    frames = [
        pl.DataFrame({"x": [[1, 2], [3]]}),
        pl.DataFrame({"x": [[1], [2, 3]]}),
        pl.DataFrame({"x": [b"\x00", b"a"]}),
        pl.DataFrame({"x": [b"\x01", b"a"]}),
        pl.DataFrame({"x": pl.Series([1, 2], dtype=pl.Datetime("ns"))}),
        pl.DataFrame({"x": pl.Series([1, 3], dtype=pl.Datetime("ns"))}),
    ]
    assert len({digest_frame(frame) for frame in frames}) == len(frames)


def test_the_digest_of_a_frame_is_the_one_documented():
    """Hashing the same bytes by hand: the layout is part of what a recording promises."""
    from hashlib import sha256

    def digest(content: bytes) -> str:
        return sha256(content).hexdigest()

    import struct

    values = digest(struct.pack("<3d", 1.5, 0.0, -2.0))
    nulls = digest(bytes([0b01000000]))
    column = digest(f'[["x","Float64"],"{values}","{nulls}"]'.encode())
    assert digest_frame(pl.DataFrame({"x": [1.5, None, -2.0]})) == digest(
        f'[3,["{column}"]]'.encode()
    )


def run(**changes: object) -> Run:
    provenance = Provenance(
        inputs=(
            InputFile(name="a.bag", sha256="aa", size_bytes=1),
            InputFile(name="b.bag", sha256="bb", size_bytes=1),
        ),
        machine={"machine": {"name": "sledge", "empty_mass_kg": 100.0}},
    )
    frames = {"aligned": FRAME, "gate": FRAME[:2]}
    return Run(frames, provenance.model_copy(update=changes)).with_fingerprint()


def test_each_part_of_a_fingerprint_says_what_it_is_of():
    mine = run().provenance.fingerprint
    renamed = (
        InputFile(name="c.bag", sha256="bb", size_bytes=1),
        InputFile(name="d.bag", sha256="aa", size_bytes=1),
    )
    assert run(inputs=renamed, versions={"payscope": "9"}, t0_unix_ns=5).provenance.fingerprint == (
        mine
    )
    assert mine is not None
    changed = {
        "inputs": run(inputs=renamed[:1]),
        "settings": run(settings=Settings().copy_with_changes({"align.rate_hz": 50.0})),
        "results": Run({"aligned": FRAME}, run().provenance).with_fingerprint(),
    }
    for part, other in changed.items():
        theirs = other.provenance.fingerprint
        assert theirs is not None
        for name in changed:
            same = getattr(mine, name) == getattr(theirs, name)
            assert same == (name != part), (part, name)


def test_the_order_and_the_names_of_frames_count():
    digests = {
        make_run_fingerprint(frames, [], {}, {}).results
        for frames in (
            {"gate": FRAME, "aligned": FRAME[:1]},
            {"aligned": FRAME[:1], "gate": FRAME},
            {"aligned": FRAME, "gate": FRAME[:1]},
        )
    }
    assert len(digests) == 3


def test_a_machine_file_in_another_order_is_the_same():
    one = make_run_fingerprint({}, [], {"machine": {"name": "a", "mass": 1.0}}, {"b": 1, "a": 2})
    two = make_run_fingerprint({}, [], {"machine": {"mass": 1.0, "name": "a"}}, {"a": 2, "b": 1})
    assert one == two
    assert str(one).startswith(f"inputs {one.inputs[:12]}  settings {one.settings[:12]}  ")
