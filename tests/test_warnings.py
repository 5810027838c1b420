"""Whose warnings fail a test: those about our own code, whatever a library says of itself."""

import warnings

import pytest


@pytest.mark.parametrize(
    "module",
    ["recordings.calibration.calibration_report", "payscope", "/a/place/estimators/recursive"],
)
def test_a_warning_about_our_own_code_is_an_error(module: str) -> None:
    with pytest.raises(DeprecationWarning):
        warnings.warn_explicit("old", DeprecationWarning, "file.py", 1, module=module)


@pytest.mark.parametrize("module", ["weasyprint.text.ffi", "analysis_of_others"])
def test_a_warning_about_the_code_of_others_is_none(module: str) -> None:
    with warnings.catch_warnings(record=True) as heard:
        warnings.warn_explicit("old", DeprecationWarning, "file.py", 1, module=module)
    assert len(heard) == 1


@pytest.mark.parametrize("kind", [RuntimeWarning, ResourceWarning])
def test_numbers_and_files_are_ours_wherever_they_are_handled(kind: type[Warning]) -> None:
    with pytest.raises(kind):
        warnings.warn_explicit("mean of empty slice", kind, "file.py", 1, module="numpy._core")
