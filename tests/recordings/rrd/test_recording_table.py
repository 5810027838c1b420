"""The one table: every declared column is drawn or knowingly not drawn."""

import pytest

from analysis.model.schema import FRAMES, find_frame_declaration
from recordings.rrd.recording_table import KEPT, TABS
from recordings.rrd.recording_views import ViewKind
from recordings.rrd.stored_names import split_frame_name_to_path

VIEWS = list(dict.fromkeys(view for tab in TABS for view in tab.views))
SERIES = [(view, series) for view in VIEWS for series in view.series]


def _drawn(frame: str) -> set[str]:
    mine = [series for _, series in SERIES if series.frame == frame]
    return {c for series in mine for c in (series.column, series.std_column) if c is not None}


@pytest.mark.parametrize("frame", FRAMES)
def test_every_declared_column_is_either_drawn_or_listed_as_kept_but_not_drawn(frame: str):
    declared = {column.name for column in FRAMES[frame].columns}
    kept = set(KEPT.get(frame, ()))
    nowhere, unknown = declared - _drawn(frame) - kept, (_drawn(frame) | kept) - declared
    assert not nowhere, (
        f"{frame}: no view draws {', '.join(sorted(nowhere))}: draw it in TABS, or name it in KEPT "
        "of recordings/rrd/recording_table.py"
    )
    assert not unknown, f"{frame}: no column {', '.join(sorted(unknown))} in the schema"
    assert _drawn(frame) & kept == set()


@pytest.mark.parametrize(("view", "series"), SERIES, ids=lambda each: getattr(each, "column", ""))
def test_every_series_is_a_declared_column_of_a_dtype_its_view_can_draw(view, series):
    column = find_frame_declaration(series.frame).column(series.column)
    assert column is not None
    numeric = column.dtype.is_float()
    assert numeric != (view.kind is ViewKind.STATES)
    if series.std_column is not None:
        assert find_frame_declaration(series.frame).column(series.std_column) is not None


@pytest.mark.parametrize("view", VIEWS, ids=lambda view: view.name)
def test_series_of_one_view_share_their_unit_and_the_title_names_it(view):
    units = {find_frame_declaration(s.frame).column(s.column).unit for s in view.series}
    assert units == {view.unit}
    assert view.unit == "1" or view.unit in view.title


def test_lanes_of_states_have_labels_of_their_own_since_they_are_entities():
    labels = {s.label: (s.frame, s.column) for v, s in SERIES if v.kind is ViewKind.STATES}
    assert len(labels) == len({s for v, s in SERIES if v.kind is ViewKind.STATES})


def test_a_topic_stays_one_part_of_its_entity_path_so_that_no_two_topics_share_one():
    assert split_frame_name_to_path("raw//imu/data") == ("raw", "/imu/data")
    assert split_frame_name_to_path("estimates/ls") == ("estimates", "ls")
