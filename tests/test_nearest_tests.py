"""`make check` runs the tests that a change may break."""

import runpy
from pathlib import Path

import pytest

REPO = Path(__file__).resolve().parent.parent
CHECK = runpy.run_path(str(REPO / ".ci/check.py"))


@pytest.fixture(scope="module")
def importers() -> dict[str, set[Path]]:
    return CHECK["importers_of"]()


def near_tests(changed: str, importers: dict[str, set[Path]]) -> list[str]:
    return CHECK["tests_of"]([Path(changed)], importers)


def test_a_test_that_imports_the_changed_file_is_near(importers):
    assert "tests/analysis/diagnosis/test_verdict.py" in near_tests(
        "analysis/diagnosis/fit_checks.py", importers
    )


def test_a_test_that_imports_what_an_init_passes_on_is_near(importers):
    """`test_faults` has `CHECKS` from `analysis.diagnosis`, which has it from `checks`."""
    assert "tests/analysis/diagnosis/test_faults.py" in near_tests(
        "analysis/diagnosis/checks.py", importers
    )


def test_a_test_of_another_name_of_the_init_is_not(importers):
    """`masses` comes from `analysis.stages.estimation`, not from `check_row`."""
    near = CHECK["files_importing"](Path("analysis/diagnosis/measured_channels.py"), importers)
    assert Path("tests/analysis/findings/test_unexplained.py") not in near


@pytest.mark.parametrize(
    "changed", ["analysis/diagnosis/checks.py", "analysis/model/verdict_limits.py"]
)
def test_tests_that_fix_results_are_near_a_table_of_checks_or_settings(changed, importers):
    assert "tests/golden/test_golden.py" in near_tests(changed, importers)


def test_every_watched_folder_and_test_exists():
    for folder, tests in CHECK["WATCHED"].items():
        assert (REPO / folder).is_dir()
        assert all((REPO / test).is_file() for test in tests)
