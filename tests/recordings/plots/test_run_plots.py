"""The one page: written whole, without warnings, for every kind of run."""

from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from analysis import Provenance, Run
from analysis.model.run_record import InputFile
from estimators.errors import OutputError
from recordings import plot_run
from recordings.plots.convergence_plot import draw_convergence_of_estimates
from recordings.plots.run_plots import FIGURES, draw_run_overview
from recordings.report.report_limits import LIMITS
from tests.twins import mark_heavy_after, mark_slow_after

DRAWN_S = (36.0, 60.0)
SIGNATURES = {".png": b"\x89PNG", ".pdf": b"%PDF", ".svg": b"<?xml"}


@pytest.fixture(autouse=True)
def small_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nobody looks at the pixels, of which each takes its time."""
    monkeypatch.setattr("recordings.report.picture.LIMITS", replace(LIMITS, picture_dpi=40))


@pytest.fixture(scope="module")
def pages(drives) -> dict[float, Figure]:
    """The page of a run of so many seconds, to be looked at."""
    return {seconds: draw_run_overview(drives(seconds)) for seconds in DRAWN_S}


@pytest.mark.parametrize("suffix", mark_heavy_after(1, SIGNATURES))
def test_the_suffix_says_the_format(drives, tmp_path: Path, suffix: str):
    path = plot_run(drives(60.0), tmp_path / f"loads{suffix}", figure_name="loads")
    assert path.read_bytes().startswith(SIGNATURES[suffix])
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.heavy
def test_a_run_without_a_calibration_can_be_drawn(drives, tmp_path: Path):
    plot_run(drives(60.0, calibration=False), tmp_path / "page.png")


def test_an_empty_run_and_names_that_look_like_formulas_can_be_drawn(tmp_path: Path):
    about = Provenance(machine={"machine": {"name": "loader $x_{1 %s 装载机"}})
    plot_run(Run({"gate": pl.DataFrame(schema={"t_ns": pl.Int64})}, about), tmp_path / "page.png")


@pytest.mark.heavy
def test_the_names_of_many_logs_stay_on_the_page(drives, tmp_path: Path):
    run = drives(30.0)
    logs = tuple(InputFile(name=f"shift_{n}.bag", sha256="0", size_bytes=1) for n in range(40))
    about = run.provenance.model_copy(update={"inputs": logs})
    few, many = (
        plot_run(each, tmp_path / name).read_text()
        for each, name in ((run, "few.svg"), (Run(run.frames, about), "many.svg"))
    )
    height_pt = [float(svg.split('height="')[1].split("pt")[0]) for svg in (few, many)]
    assert height_pt[1] > height_pt[0]


def test_an_existing_picture_is_replaced_only_when_forced(drives, tmp_path: Path):
    path = tmp_path / "loads.png"
    path.write_bytes(b"old")
    with pytest.raises(OutputError, match=r"exists already.*--force"):
        plot_run(drives(60.0), path, figure_name="loads")
    assert path.read_bytes() == b"old"
    plot_run(drives(60.0), path, overwrites=True, figure_name="loads")
    assert path.read_bytes() != b"old"


def test_another_suffix_or_a_missing_folder_is_one_line(drives, tmp_path: Path):
    with pytest.raises(OutputError, match=r"no picture format '\.bmp'; use \.png, \.pdf, \.svg"):
        plot_run(drives(60.0), tmp_path / "page.bmp")
    with pytest.raises(OutputError, match=r"no folder '.*nowhere'"):
        plot_run(drives(60.0), tmp_path / "nowhere" / "page.png")


PANELS = (
    "Force (N)",
    "Acceleration (m/s²)",
    "Speed (m/s)",
    "Information index (nat)",
    "Mass of each load (kg)",
    "Mass (kg)",
    "Viscous friction (N·s/m)",
    "Yaw inertia (kg·m²)",
    "Centre of mass (m)",
)


def panels(figure: Figure) -> dict[str, Axes]:
    """The panels over time by name and unit, from top to bottom, but for lanes of states."""
    named = ((axes.get_ylabel().replace("\n", " "), axes) for axes in figure.subfigs[1].axes)
    return {name: axes for name, axes in named if name}


def line(axes: Axes, label: str) -> tuple[np.ndarray, np.ndarray]:
    (found,) = (each for each in axes.lines if each.get_label() == label)
    return np.asarray(found.get_xdata()), np.asarray(found.get_ydata())


def legend(axes: Axes) -> list[str]:
    return [text.get_text() for text in axes.get_legend().get_texts()]


@pytest.mark.heavy
def test_the_panels_are_named_with_their_units_over_seconds_since_the_start(pages):
    found = panels(pages[60.0])
    assert tuple(found) == PANELS
    *others, last = found.values()
    assert last.get_xlabel() == "s since 2023-11-14 19:13:20 -03:00 America/Santiago"
    assert all(axes.get_xlabel() == "" for axes in others)
    for axes in found.values():
        assert axes.get_xlim() == (0.0, pytest.approx(59.99))


@pytest.mark.parametrize(
    ("panel", "label", "frame", "column"),
    [
        ("Force (N)", "driving force", "excitation", "force_x_N"),
        ("Acceleration (m/s²)", "kinematic", "excitation", "acc_x_m_s2"),
        ("Speed (m/s)", "speed", "excitation", "speed_x_m_s"),
        ("Information index (nat)", "index of the window", "gate", "mi_x_nat"),
        ("Mass (kg)", "rls", "estimates/rls", "mass_kg"),
        ("Viscous friction (N·s/m)", "tls", "estimates/tls", "friction_x_N_s_m"),
        ("Yaw inertia (kg·m²)", "ls", "estimates/ls", "inertia_z_kg_m2"),
    ],
)
def test_a_line_holds_the_numbers_of_its_column_and_breaks_where_there_are_none(
    drives, pages, panel, label, frame, column
):
    # up to 4000 samples are drawn one by one
    run = drives(36.0)
    t_s, numbers = line(panels(pages[36.0])[panel], label)
    stored = run.frames[frame].select("t_ns", column)
    there = stored.drop_nulls()
    drawn = np.isfinite(numbers)
    np.testing.assert_allclose(t_s[drawn], there["t_ns"] / 1e9)
    np.testing.assert_array_equal(numbers[drawn], there[column])
    # between rows that are further apart than a window's step, nothing is joined
    steps = np.diff(there["t_ns"])
    gaps = np.flatnonzero(steps > 2 * steps.min())
    for before, after in zip(there["t_ns"][gaps], there["t_ns"][gaps + 1], strict=True):
        inside = (t_s > before / 1e9) & (t_s < after / 1e9)
        assert np.isnan(numbers[inside]).any()


@pytest.mark.heavy
def test_more_points_than_fit_are_drawn_by_the_mean_and_the_extremes_of_each_bin(drives):
    run = drives(900.0)
    axes = panels(draw_run_overview(run))["Force (N)"]
    t_s, _ = line(axes, "driving force")
    force = run.frames["excitation"]["force_x_N"]
    assert t_s.size < force.len() / 10
    envelope = axes.collections[0].get_datalim(axes.transData)
    assert envelope.y0 == pytest.approx(force.min())
    assert envelope.y1 == pytest.approx(force.max())


def test_a_band_is_one_standard_deviation_on_each_side(drives, pages):
    run = drives(36.0)
    axes = panels(pages[36.0])["Mass (kg)"]
    order = [each.get_label() for each in axes.lines]
    assert order == ["ls", "rls", "fgls", "tls", "pooled"]
    frame = run.frames["estimates/rls"]
    bands = [each for each in axes.collections if each.get_alpha() == 0.2]
    edges = np.concatenate([path.vertices for path in bands[order.index("rls")].get_paths()])
    for side in (-1.0, 1.0):
        wanted = frame["mass_kg"] + side * frame["mass_std_kg"]
        for t_ns, edge in list(zip(frame["t_ns"], wanted, strict=True))[::50]:
            near = edges[np.abs(edges[:, 0] - t_ns / 1e9) < 1e-6]
            assert np.abs(near[:, 1] - edge).min() < 1e-6 * abs(edge)


def test_a_panel_of_several_lines_has_a_legend_and_one_of_a_single_line_none(pages):
    found = panels(pages[60.0])
    assert legend(found["Mass (kg)"]) == ["ls", "rls", "fgls", "tls", "pooled"]
    assert legend(found["Information index (nat)"]) == [
        "index of the window",
        "mutual information by nearest neighbours",
        "index of the window, yaw",
        "mutual information by nearest neighbours, yaw",
        "threshold 0.7 nat",
    ]
    # arcs tell how far ahead it is, and no more
    assert found["Centre of mass (m)"].get_legend() is None
    assert found["Force (N)"].get_legend() is None


def test_the_threshold_is_a_level_over_the_whole_log(pages):
    axes = panels(pages[36.0])["Information index (nat)"]
    t_s, level = line(axes, "threshold 0.7 nat")
    np.testing.assert_allclose(t_s, [0.0, 35.99])
    np.testing.assert_array_equal(level, [0.7, 0.7])


def test_wild_estimates_leave_the_axis_to_the_bulk(pages):
    axes = panels(pages[60.0])["Mass (kg)"]
    _, tls = line(axes, "tls")
    low, high = axes.get_ylim()
    assert np.nanmax(tls) == 2.5e6
    assert 2500.0 < low < 3500.0 < high < 4500.0


def test_what_is_shaded_are_the_accepted_windows(drives, pages):
    run = drives(60.0)
    axes = panels(pages[60.0])["Information index (nat)"]
    (shaded,) = (each for each in axes.collections if each.get_alpha() == 0.15)
    spans = [path.get_extents() for path in shaded.get_paths()]
    accepted = run.frames["gate"].filter("accepted_x")["t_ns"] / 1e9
    inside = [sum(((accepted >= s.x0) & (accepted < s.x1)).sum() for s in spans)]
    assert inside == [accepted.len()]
    assert sum(span.width for span in spans) == pytest.approx(accepted.len() * 0.01, abs=0.02)


def test_the_answer_and_the_checks_are_written_above(pages):
    head = pages[60.0].subfigs[0]
    assert (
        "3500 ± 41 kg (standard uncertainty, scale error not included)" in head._suptitle.get_text()
    )
    (text,) = (each.get_text() for each in head.axes[0].texts)
    assert "passed   partial_correlation 0.93" in text


def test_the_calibration_shows_each_point_and_line_and_what_is_left_of_them(drives, pages):
    run = drives(60.0)
    fits, errors = pages[60.0].subfigs[2].axes
    assert (fits.get_xlabel(), fits.get_ylabel()) == ("estimate (kg)", "reference (kg)")
    assert errors.get_ylabel() == "calibrated − reference (kg)"
    assert legend(fits) == ["ls", "rls", "fgls", "tls", "pooled"]
    points = run.frames["calibration"].filter(method="rls")
    known, left = line(errors, "rls")
    np.testing.assert_array_equal(known, points["reference_kg"])
    np.testing.assert_array_equal(left, points["error_kg"])
    drawn = [np.column_stack(each.get_data()) for each in fits.lines]
    marks = points.select("estimate_kg", "reference_kg").to_numpy()
    line_of_19 = np.column_stack([points["estimate_kg"], points["calibrated_kg"]])
    for wanted in (marks, line_of_19):
        assert any(each.shape == wanted.shape and np.allclose(each, wanted) for each in drawn)


def test_a_run_without_a_calibration_has_no_third_part(drives):
    assert len(draw_run_overview(drives(60.0, calibration=False)).subfigs) == 2


#: Of the last, the page is drawn where no legend covers a panel.
KINDS = ({}, {"accepted": False}, {"passed": False}, {"duration_s": 700.0})


def is_alike(pair: tuple[dict, str]) -> bool:
    """A part of the page of a run with nothing accepted or passed, and what has only more points.

    The page has all of its parts.
    """
    options, figure = pair
    return options == KINDS[-1] or (bool(options) and figure != "page")


PAIRS = sorted(product(KINDS, FIGURES), key=is_alike)


@pytest.mark.heavy
@pytest.mark.parametrize(
    ("options", "figure"),
    mark_slow_after(sum(not is_alike(pair) for pair in PAIRS), PAIRS),
    ids=lambda each: str(each),
)
def test_every_figure_draws_every_kind_of_run(drives, tmp_path: Path, figure: str, options: dict):
    run = drives(**{"duration_s": 60.0, **options})
    plot_run(run, tmp_path / "whole.png", figure_name=figure)
    if not options:  # a moment's marks are the same on each
        plot_run(run, tmp_path / "moment.png", figure_name=figure, at_s=30.0)


@pytest.mark.parametrize("figure", FIGURES)
def test_every_figure_of_a_run_without_frames_says_so(tmp_path: Path, figure: str):
    plot_run(Run({}), tmp_path / "empty.png", figure_name=figure)


def test_an_unknown_figure_is_one_line_with_the_choices(drives, tmp_path: Path):
    with pytest.raises(OutputError, match="no figure 'gates'; did you mean 'gate'"):
        plot_run(drives(60.0), tmp_path / "page.png", figure_name="gates")


def lanes(figure: Figure) -> Axes:
    """The lanes of the gate and the phase."""
    named = [
        [text.get_text() for text in axes.get_yticklabels()] for axes in figure.subfigs[1].axes
    ]
    return figure.subfigs[1].axes[named.index(["gate", "yaw gate", "phase"])]


@pytest.mark.heavy
def test_few_states_are_drawn_as_stretches_and_many_as_shares_of_time(drives, pages):
    short, long = lanes(pages[60.0]), lanes(draw_run_overview(drives(2400.0)))
    assert not short.patches
    assert len(short.collections) > 0
    bars = [bar for bar in long.patches if bar.get_y() >= 2.0]
    assert len(bars) > 300
    # of the uppermost lane each bin is full, but for a gap and the end
    tops = {round(bar.get_x(), 3): 0.0 for bar in bars}
    for bar in bars:
        tops[round(bar.get_x(), 3)] += bar.get_height()
    full = [top for top in tops.values() if top == pytest.approx(0.84, abs=0.01)]
    assert len(full) > 0.9 * len(tops)


@pytest.mark.heavy
def test_no_legend_covers_a_panel(drives, pages):
    for figure in (pages[60.0], draw_run_overview(drives(700.0))):
        figure.draw_without_rendering()
        for axes in figure.subfigs[1].axes:
            legend = axes.get_legend()
            if legend is not None:
                assert legend.get_window_extent().y0 >= axes.get_window_extent().y1 - 1.0


def _settling(rls_kg: float) -> Run:
    """Two starts of one load of 100 kg, and a recursion that says something else."""
    t_ns = [*range(0, 10**9, 10**7), *range(5 * 10**9, 6 * 10**9, 10**7)]
    numbers = {"mass_kg": [rls_kg] * len(t_ns), "mass_std_kg": [1.0] * len(t_ns)}
    load = {"start_t_ns": [0], "end_t_ns": [6 * 10**9], "mass_kg": [100.0], "u_kg": [2.0]}
    return Run(
        {
            "aligned": pl.DataFrame({"t_ns": range(0, 6 * 10**9, 10**7)}),
            "estimates/rls": pl.DataFrame({"t_ns": t_ns, **numbers}),
            "loads": pl.DataFrame(load),
        }
    )


def test_the_answer_is_in_view_wherever_a_recursion_lies() -> None:
    axes = Figure().subplots()
    draw_convergence_of_estimates(axes, _settling(500.0))
    low, high = axes.get_ylim()
    assert low < 96.0 < 500.0 < high
    assert axes.get_xlim() == pytest.approx((0.0, 5.99))


def test_no_line_is_drawn_where_nothing_was_accepted() -> None:
    axes = Figure().subplots()
    draw_convergence_of_estimates(axes, _settling(100.0))
    (line,) = (each for each in axes.get_lines() if str(each.get_label()).startswith("rls"))
    t_s = np.asarray(line.get_xdata())
    assert np.isnan(t_s).sum() == 1
    assert np.nanmax(np.diff(t_s)) == pytest.approx(0.01)
