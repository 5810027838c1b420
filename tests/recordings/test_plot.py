"""The one page: written whole, without warnings, for every kind of run."""

from pathlib import Path

import polars as pl
import pytest

from analysis import Provenance, Run
from analysis.run import InputFile
from estimators.errors import OutputError
from recordings import plot_run

SIGNATURES = {".png": b"\x89PNG", ".pdf": b"%PDF", ".svg": b"<?xml"}


@pytest.mark.parametrize("suffix", SIGNATURES)
def test_the_suffix_says_the_format(drives, tmp_path: Path, suffix: str):
    path = plot_run(drives(60.0), tmp_path / f"page{suffix}")
    assert path.read_bytes().startswith(SIGNATURES[suffix])
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    "options",
    [
        {"passed": False},
        {"accepted": False},
        {"calibration": False},
        {"duration_s": 900.0},
    ],
    ids=lambda each: str(each),
)
def test_every_kind_of_run_can_be_drawn(drives, tmp_path: Path, options: dict):
    plot_run(drives(**options), tmp_path / "page.png")


def test_an_empty_run_and_names_that_look_like_formulas_can_be_drawn(tmp_path: Path):
    about = Provenance(machine={"machine": {"name": "loader $x_{1 %s 装载机"}})
    plot_run(Run({"gate": pl.DataFrame(schema={"t_ns": pl.Int64})}, about), tmp_path / "page.png")


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
    path = tmp_path / "page.png"
    path.write_bytes(b"old")
    with pytest.raises(OutputError, match=r"exists already.*--force"):
        plot_run(drives(60.0), path)
    assert path.read_bytes() == b"old"
    plot_run(drives(60.0), path, force=True)
    assert path.read_bytes() != b"old"


def test_another_suffix_or_a_missing_folder_is_one_line(drives, tmp_path: Path):
    with pytest.raises(OutputError, match=r"no picture format '\.bmp'; use \.png, \.pdf, \.svg"):
        plot_run(drives(60.0), tmp_path / "page.bmp")
    with pytest.raises(OutputError, match=r"no folder '.*nowhere'"):
        plot_run(drives(60.0), tmp_path / "nowhere" / "page.png")
