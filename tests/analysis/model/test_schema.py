"""The one declaration of every column."""

import numpy as np
import polars as pl
import pytest

from analysis.model.schema import (
    CHANNEL_COLUMNS,
    FRAMES,
    NOISE_SOURCES,
    PHASES,
    QUALITIES,
    REASONS,
    build_frame,
    conform_frame_to_schema,
    find_frame_declaration,
    get_column_values,
)

COLUMNS = [(frame.name, column) for frame in FRAMES.values() for column in frame.columns]


@pytest.mark.parametrize(
    ("frame", "column"), COLUMNS, ids=[f"{name}.{column.name}" for name, column in COLUMNS]
)
def test_every_column_has_a_unit_and_a_meaning(frame, column):
    assert column.unit
    assert column.meaning
    assert column == find_frame_declaration(frame).column(column.name)


UNIT_SUFFIXES = {
    "_ns": "ns",
    "_N": "N",
    "_N_m": "N·m",
    "_m": "m",
    "_m_s": "m/s",
    "_m_s2": "m/s²",
    "_rad": "rad",
    "_rad_s": "rad/s",
    "_rad_s2": "rad/s²",
    "_deg": "°",
    "_kg": "kg",
    "_nat": "nat",
    "_N_s_m": "N·s/m",
    "_N_m_s": "N·m·s",
    "_kg_m": "kg·m",
    "_kg_m2": "kg·m²",
    "_1": "1",
}


def test_a_name_that_ends_in_a_unit_means_that_unit():
    for _, column in COLUMNS:
        matches = [suffix for suffix in UNIT_SUFFIXES if column.name.endswith(suffix)]
        if matches:
            assert UNIT_SUFFIXES[max(matches, key=len)] == column.unit, column.name


#: A value of a machine file may be of any kind, so it is kept as TOML writes it.
AS_TEXT = {("findings", "value")}


def test_a_name_means_the_same_unit_and_dtype_in_every_frame():
    units = {}
    for frame, column in COLUMNS:
        if (frame, column.name) in AS_TEXT:
            continue
        meant = (column.unit, column.dtype)
        assert units.setdefault(column.name, meant) == meant, column.name


def test_a_name_says_the_dtype():
    whole = ("segment_id", "samples", "samples_accepted", "rows", "rows_z", "runs", "rank", "lag")
    whole += ("load_id", "manoeuvres", "mean_samples", "payload_to")
    words = ("kind", "identifiable", "combinations", "method", "check", "about", "meaning")
    words += ("first", "second", "consequence", "remedy", "scale_unknown", "withheld_for")
    words += ("scale_from", "payload_scale_unknown", "com_scale_unknown", "quantity")
    words += ("calibrated_said", "of", "other")
    whole += ("number",)
    words += ("term", "unit", "cause", "shrinks", "said", "calibrated_reason")
    truths = ("gap", "accepted_x", "accepted_z", "withheld", "withheld_z", "passed")
    words += ("run_id", "load", "day", "log", "left_out_for", "log_sha256", "recording")
    whole += ("readings", "reading", "rejected", "cycle", "cycles", "cycles_counted")
    whole += ("cycles_rejected", "cycles_without_mass", "loaded_id", "empty_before_id")
    whole += ("empty_after_id", "rank", "digs", "boom_dumps")
    words += ("severity", "channel", "evidence", "setting", "alternatives")
    truths += ("braking_left_out", "scatter_known", "empty", "used", "counted", "told")
    dtypes = {
        **dict.fromkeys(whole, pl.Int64),
        **dict.fromkeys(words, pl.String),
        **dict.fromkeys(truths, pl.Boolean),
        **dict.fromkeys(("reason", "reason_x", "reason_z"), pl.Enum(REASONS)),
        "phase": pl.Enum(PHASES),
        "quality": pl.Enum(QUALITIES),
        "axis": pl.Enum(["x", "z"]),
        "source": pl.Enum(NOISE_SOURCES),
    }
    for frame, column in COLUMNS:
        if (frame, column.name) in AS_TEXT:
            assert column.dtype == pl.String
            continue
        time = pl.Int64 if column.name.endswith("_ns") else pl.Float64
        assert column.dtype == dtypes.get(column.name, time), f"{frame}.{column.name}"


def test_no_frame_declares_a_column_twice():
    for frame in FRAMES.values():
        names = [column.name for column in frame.columns]
        assert len(names) == len(set(names))
        assert frame.meaning


def test_every_channel_is_a_column_of_aligned():
    assert {c.name for c in CHANNEL_COLUMNS} <= {c.name for c in FRAMES["aligned"].columns}


def test_a_frame_of_a_method_has_its_stages_schema():
    assert find_frame_declaration("estimates/ls") is FRAMES["estimates"]
    with pytest.raises(KeyError):
        find_frame_declaration("raw/imu")


@pytest.mark.parametrize(
    ("frame", "column"),
    [("aligned", "t_ns"), ("segments", "start_t_ns"), ("masses", None), ("verdict", None)],
)
def test_a_frame_knows_what_places_it_in_time(frame, column):
    assert FRAMES[frame].time_column == column


def test_conform_orders_and_casts():
    frame = conform_frame_to_schema(
        "gate", pl.DataFrame({"accepted_x": [True], "t_ns": pl.Series([1], dtype=pl.Int8)})
    )
    assert list(frame.schema.items()) == [("t_ns", pl.Int64), ("accepted_x", pl.Boolean)]


def test_conform_refuses_a_column_without_a_declaration():
    with pytest.raises(
        KeyError, match=r"gate: columns without a declaration: \['colour', 'size'\]"
    ):
        conform_frame_to_schema("gate", pl.DataFrame({"t_ns": [1], "size": [1], "colour": [1]}))


@pytest.mark.parametrize("make", [np.array, pl.Series], ids=["array", "series"])
def test_nan_becomes_null_whatever_it_came_in(make):
    frame = build_frame("aligned", {"t_ns": make([1, 2]), "force_x_N": make([np.nan, 2.0])})
    assert frame["force_x_N"].to_list() == [None, 2.0]


def test_values_are_floats_with_nan_for_null_and_for_a_column_that_is_not_there():
    frame = pl.DataFrame({"samples": [1, None], "passed": [True, None]})
    np.testing.assert_array_equal(get_column_values(frame, "samples"), [1.0, np.nan])
    np.testing.assert_array_equal(get_column_values(frame, "passed"), [1.0, np.nan])
    np.testing.assert_array_equal(get_column_values(frame, "absent"), [np.nan, np.nan])


def test_phases_and_reasons_are_those_of_the_design():
    assert PHASES == (
        "standstill",
        "accelerating",
        "cruising",
        "braking",
        "spinning",
        "arc",
        "turning",
    )
    assert REASONS[0] == "accepted"
    assert len(set(REASONS)) == 15
