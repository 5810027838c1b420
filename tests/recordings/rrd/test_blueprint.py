"""The blueprint draws what is there, and only that."""

from dataclasses import replace
from pathlib import Path

import polars as pl
import pyarrow as pa
import pytest

from analysis import Run
from recordings import write_recording
from recordings.rrd.blueprint import Page, Panel, compute_relative_panel_heights, make_panels_of_tab
from recordings.rrd.display_frames import DisplayColumn, make_display_frames
from recordings.rrd.recording_table import TABS
from recordings.rrd.recording_views import MethodLayout, Tab, ViewKind
from recordings.rrd.writer import make_scene_of_run
from tests.recordings.conftest import METHODS
from tests.twins import mark_heavy_after


def _components(path: Path) -> dict[tuple[str, str], pa.DataType]:
    """The dtype of every component that the recording holds, by entity and name."""
    import rerun as rr

    return {
        (chunk.entity_path, field.name): field.type.value_type
        for chunk in rr.chunk.RrdReader(path).store().stream()
        for field in chunk.to_record_batch().schema
        if pa.types.is_list(field.type)
    }


def _mappings(path: Path) -> list[tuple[str, str, str]]:
    """Entity, target and source of every mapping in the blueprint that the recording carries."""
    import rerun as rr

    reader = rr.chunk.RrdReader(path)
    (embedded,) = reader.blueprints()
    found: list[tuple[str, str, str]] = []
    for chunk in reader.stream(store=embedded):
        batch = chunk.to_record_batch()
        if "VisualizerInstruction:component_map" in batch.schema.names:
            path_of = chunk.entity_path.split("/overrides", 1)[1].rsplit("/visualizers/", 1)[0]
            rows = batch.column("VisualizerInstruction:component_map").to_pylist()
            found += [(path_of, m["target"], m["source_component"]) for row in rows for m in row]
    return found


@pytest.mark.heavy
@pytest.mark.parametrize(
    "duration_s", mark_heavy_after(1, [60.0, 700.0]), ids=["short", "long, with an overview"]
)
def test_every_mapping_of_the_embedded_blueprint_names_a_component_that_can_be_drawn(
    drives, tmp_path: Path, duration_s: float
):
    path = write_recording(drives(duration_s), tmp_path / "shift.rrd")
    components, mappings = _components(path), _mappings(path)
    assert len(mappings) > 50
    for entity, target, source in mappings:
        dtype = components[entity, source]
        wanted = pa.types.is_string if target == "StateChange:state" else pa.types.is_floating
        assert wanted(dtype), f"{entity} {source} is {dtype}"


@pytest.mark.heavy
def test_every_stage_that_the_table_draws_is_mapped(drives, tmp_path: Path):
    path = write_recording(drives(60.0), tmp_path / "shift.rrd")
    mapped = {source for _, _, source in _mappings(path)}
    lines = [
        s for tab in TABS for view in tab.views for s in view.series if view.kind.name != "STATES"
    ]
    # arcs tell how far ahead the centre of mass is, and no more
    drawn = {series.column for series in lines} - {"com_y_m"}
    assert {f"payscope:{column}" for column in drawn} <= mapped


def _view_names(container) -> list[str]:
    contents = getattr(container, "contents", None)
    if not isinstance(contents, (list, tuple)) or not hasattr(container, "kind"):
        return [container.name]
    return [name for each in contents for name in _view_names(each)]


def _tabs(run: Run) -> dict[str, list[str]]:
    root = make_scene_of_run(run).layout.root_container
    return {tab.name: _view_names(tab) for tab in root.contents}


@pytest.mark.parametrize("plots", [0, 1, 4, 7])
@pytest.mark.parametrize("lanes", [(1,), (2,), (4,), (6,), (2, 4), (12,)])
def test_lanes_have_the_height_that_they_need_and_leave_some_to_plots(
    plots: int, lanes: tuple[int, ...]
) -> None:
    def panel(kind: ViewKind, count: int) -> Panel:
        return Panel("any", kind, (DisplayColumn("frame", "column", "label", "#000000"),) * count)

    states = tuple(panel(ViewKind.STATES, count) for count in lanes)
    shares = compute_relative_panel_heights(
        Page("page", (*states, *(panel(ViewKind.LINES, 1) for _ in range(plots))))
    )
    assert len(shares) == len(lanes) + plots
    assert sum(shares) <= 1.0 + 1e-9
    # of a window of 1000 points, 900 are a page's; a title and the times take 65, a lane 40
    if sum(lanes) <= 10:
        for share, count in zip(shares, lanes, strict=False):
            assert 900.0 * share >= 65.0 + 40.0 * count
    assert sum(shares[len(lanes) :]) == pytest.approx(1.0 - sum(shares[: len(lanes)])) or not plots


def test_a_panel_is_as_high_as_its_legend_needs() -> None:
    def panel(*labels: str, shares_legend_of_panel_above: bool = False) -> Panel:
        drawn = tuple(DisplayColumn("frame", "column", label, "#000000") for label in labels)
        return Panel(
            "any", ViewKind.LINES, drawn, shares_legend_of_panel_above=shares_legend_of_panel_above
        )

    five = panel("a", "b", "c", "d", "e")
    above = panel("a", "b", "c", "d", "e", shares_legend_of_panel_above=True)
    twice = panel("a", "a", "b", "b")
    shares = compute_relative_panel_heights(
        Page("page", (panel("x"), panel("x"), five, above, twice, panel("x")))
    )
    assert sum(shares) == pytest.approx(1.0)
    lone, _, high, unnamed, low, _ = shares
    # 900 points are a page's; the viewer gives a legend four fifths of a plot, a name 23 points
    assert 900.0 * high >= 50.0 + 5 * 23.0 / 0.8
    assert 900.0 * low >= 50.0 + 2 * 23.0 / 0.8
    assert unnamed == lone == low
    # too many to fit: none vanishes
    assert min(compute_relative_panel_heights(Page("page", (five,) * 12))) == pytest.approx(1 / 12)


def test_the_overview_comes_first_with_the_answer_beside_the_plots(drives):
    tabs = _tabs(drives(60.0))
    assert next(iter(tabs)) == "Overview"
    assert tabs["Overview"] == [
        "Answer",
        "Force (N)",
        "Speed (m/s)",
        "Information index (nat)",
        "Gate and phase",
        "Mass of each load (kg)",
        "Mass (kg), rls",
        "Yaw inertia (kg·m²), rls",
    ]


def test_views_of_frames_that_are_missing_or_empty_are_left_out(drives):
    nothing = _tabs(drives(60.0, accepted=False, calibration=False))
    assert not any(name.startswith("Mass (kg)") for name in nothing["Overview"])
    assert "Estimates" not in nothing
    assert "Calibration" not in nothing
    assert "Phase and outcome" in nothing["Manoeuvres"]


def _methods_of(panel: Panel) -> set[str]:
    frames = {each.frame for each in panel.columns}
    return {method for method in METHODS if f"display/estimates/{method}" in frames}


@pytest.mark.parametrize("tab", TABS, ids=lambda tab: tab.name)
def test_no_view_draws_two_methods_over_each_other(drives, tab: Tab) -> None:
    run = drives(60.0)
    rows = Page(tab.name, make_panels_of_tab(tab, run, make_display_frames(run))).panel_rows
    assert all(len(_methods_of(panel)) <= 1 for row in rows for panel in row)
    if tab.methods is MethodLayout.ROWS:
        assert [_methods_of(row[0]) for row in rows] == [{method} for method in METHODS]
        assert all(_methods_of(panel) == _methods_of(row[0]) for row in rows for panel in row)
        # below each other they can be compared: one axis
        assert all(
            len({panel.axis_range for panel in each}) == 1 for each in zip(*rows, strict=True)
        )


def _with_cycles(run: Run, *qualities: str) -> Run:
    count = len(qualities)
    cycles = pl.DataFrame(
        {
            "start_t_ns": [number * 10**10 for number in range(count)],
            "end_t_ns": [(number + 1) * 10**10 - 1 for number in range(count)],
            "payload_kg": [500.0] * count,
            "payload_u_kg": [20.0] * count,
            "quality": qualities,
        }
    )
    return replace(run, frames={**run.frames, "cycles": cycles})


def test_a_log_in_which_nothing_is_dumped_has_no_tab_of_cycles(drives) -> None:
    assert "Cycles" not in _tabs(_with_cycles(drives(60.0), "not dumped"))
    shift = _tabs(_with_cycles(drives(60.0), "good", "not dumped"))
    assert shift["Cycles"] == ["Payload of each cycle (kg)", "Cycle", "Speed (m/s)"]


def test_a_tab_that_would_hold_nothing_but_its_context_is_left_out(drives) -> None:
    nothing = _tabs(drives(60.0, accepted=False))
    assert not {"Loads", "Cycles", "Estimates", "Turning", "Residuals"} & nothing.keys()


def test_a_lane_of_gaps_needs_a_gap(drives) -> None:
    run = drives(60.0)
    whole = run.frames["aligned"].with_columns(gap=pl.lit(value=False))
    (tab,) = (tab for tab in TABS if tab.name == "Motion")
    for frames, lanes in ((run.frames, 2), ({**run.frames, "aligned": whole}, 1)):
        each = replace(run, frames=frames)
        *_, states = make_panels_of_tab(tab, each, make_display_frames(each))
        assert len(states.columns) == lanes


def test_a_centre_of_mass_that_no_arc_tells_has_no_view(drives) -> None:
    run = drives(60.0)
    assert "Centre of mass (m)" in _tabs(run)["Planar"]
    unknown = pl.when(pl.col("kind") != "arc").then("com_x_m").alias("com_x_m")
    planar = run.frames["planar"].with_columns(unknown)
    run = replace(run, frames={**run.frames, "planar": planar})
    assert "Centre of mass (m)" not in _tabs(run)["Planar"]


def test_pictures_stand_beside_the_text_and_in_a_tab(drives) -> None:
    tabs = _tabs(drives(60.0))
    assert tabs["Scatter"] == ["Force against acceleration"]
    text, line, errors = tabs["Calibration"]
    assert (text, line) == ("Calibration", "Line of the calibration")
    assert errors.startswith("Errors of the calibration")


def test_a_run_without_any_frame_still_opens_with_its_answer_and_provenance(tmp_path: Path):
    run = Run({"aligned": pl.DataFrame(schema={"t_ns": pl.Int64, "force_x_N": pl.Float64})})
    assert _tabs(run) == {"Overview": ["Answer"], "Provenance": ["Settings", "Provenance"]}
    write_recording(run, tmp_path / "empty.rrd")
