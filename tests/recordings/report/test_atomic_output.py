"""Outputs that are whole or not there, and what was there before them."""

from pathlib import Path

import pytest

from estimators.errors import OutputError
from recordings.report.atomic_output import stage_output_files


def evidence(folder: Path, text: str) -> Path:
    folder.mkdir()
    (folder / "evidence.json").write_text(text)
    return folder


@pytest.mark.parametrize("fault", [KeyboardInterrupt, OSError])
def test_a_folder_stays_where_its_successor_does_not_get_its_place(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fault: type[BaseException]
) -> None:
    target = evidence(tmp_path / "made", "old")
    rename, renamed = Path.replace, list[Path]()

    def fail_between_both(path: Path, to: Path) -> Path:
        renamed.append(path)
        if len(renamed) == 2:
            raise fault
        return rename(path, to)

    monkeypatch.setattr(Path, "replace", fail_between_both)
    with (
        pytest.raises((fault, OutputError)),
        stage_output_files([target], overwrites=True) as stage,
    ):
        evidence(stage / target.name, "new")
    assert (target / "evidence.json").read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


def test_a_file_within_is_named_by_the_path_that_the_user_gave(tmp_path: Path) -> None:
    target = tmp_path / "made"
    within = target / "calibration.rrd"
    with (
        pytest.raises(OutputError, match=f"^{within}: cannot be written"),
        stage_output_files([target], overwrites=False) as stage,
    ):
        raise OutputError(f"{stage / target.name / within.name}: cannot be written (full)")
