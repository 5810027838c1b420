"""The tables of docs/findings.md are of the code as it is."""

from pathlib import Path

from benchmarks.findings import code_digest

PAGE = Path(__file__).resolve().parents[3] / "docs" / "findings.md"


def test_the_confusion_matrix_is_of_this_code() -> None:
    assert f"Code: `{code_digest()}`" in PAGE.read_text(encoding="utf-8"), (
        "findings, checks or faults changed since docs/findings.md was measured: make findings"
    )
