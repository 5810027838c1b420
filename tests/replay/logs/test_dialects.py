"""Tables of many dialects: times and numbers are those of the drive, or there is a question."""

from pathlib import Path

import numpy as np
import pytest

from analysis.model.physical_units import find_pint_unit_name
from benchmarks.dialects.dialect_file import DRIVE, RATE_HZ, DialectFile
from benchmarks.dialects.every_file import SETS, readable_files_of_set
from estimators.errors import LogError
from replay.commands.common_options import make_time_axis_from_options
from replay.logs import open_log
from tests.one_line import assert_one_line
from tests.twins import mark_heavy_after

#: What is lost or moved in them is declared.
DECLARED = (
    "Siemens S7 data log: UTC Time to the second, //END",
    *("TwinCAT: EOF in the last line", "names again after each thousand rows"),
    *("shuffled rows", "a footer of sums", "the newest row first"),
    "readings that are missing as ---",
    "TunerStudio: two lines of head, tabs, units below, marks between",
)
#: Their time is asked for by `init`, since an accelerometer contradicts it.
ASKED_BY_THE_DRAFT = ("ticks of a tenth of a millisecond", "seconds by the name, milliseconds")
#: Answered by a person: steps of 1,000 µs, not the drive's.
STEP_NS = {"steps of 1000 are asked for": 10**6}


def written(tmp_path: Path, file: DialectFile) -> Path:
    path = tmp_path / f"log{file.suffix}"
    path.write_bytes(file.data)
    return path


@pytest.mark.heavy
@pytest.mark.parametrize("name", mark_heavy_after(1, SETS))
def test_a_dialect_is_read_as_it_was_driven(
    tmp_path: Path, name: str, subtests: pytest.Subtests
) -> None:
    """A set in one test: it is written where it is read, and not by each worker."""
    for file in readable_files_of_set(name):
        with subtests.test(file.name):
            assert_read_as_driven(tmp_path, file)


def assert_read_as_driven(tmp_path: Path, file: DialectFile) -> None:
    path = written(tmp_path, file)
    if file.keys and not file.name.startswith(ASKED_BY_THE_DRAFT):
        with pytest.raises(LogError, match=r"\[log\]") as asked:
            open_log(path).topics()
        assert_one_line(asked.value)
    log = open_log(path, time=make_time_axis_from_options(None, None, list(file.keys)))
    step_ns = STEP_NS.get(file.name, round(1e9 / RATE_HZ))
    for quantity, (name, factor) in file.fields.items():
        frame = log.read(file.topic.get(quantity, "table"), [name])
        t = frame["log_time_ns"].to_numpy()
        begins_ns = 0 if file.t0_ns is None else file.t0_ns
        expected_ns = begins_ns + np.arange(t.size) * step_ns
        # serials and floats since 1970 keep no microsecond
        assert np.abs(t - expected_ns).max() < 20_000
        expected = DRIVE[quantity][: t.size] * factor
        digits = max(np.abs(expected).max() * 1e-4, 0.51)
        # a footer is a row where rows have no time of their own
        found = frame[name].cast(float).to_numpy()[: expected.size]
        assert np.isnan(found).mean() < (0.03 if file.name in DECLARED else 1e-9)
        assert np.nanmax(np.abs(found - expected)) < digits, name
    assert not log.losses() or file.name in DECLARED


def test_units_in_names_and_rows_are_known() -> None:
    for text, unit in (
        ("[Nm]", "N*m"), ("km/h", "km/h"), ("(m/s²)", "m/s**2"), ("1/min", "rpm"), ("°/s", "deg/s"),
        ("mN", None), ("banana", None),
    ):  # fmt: skip
        assert find_pint_unit_name(text) == unit
