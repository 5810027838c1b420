"""Units that stand in the metadata of a Parquet or Arrow file."""

import json
from collections.abc import Callable
from pathlib import Path

import pandas as pd
import pyarrow as pa
import pytest
from pyarrow import feather, parquet

from replay.logs import open_log
from replay.logs.tables.parquet_columns import find_schema_units


def _parquet(table: pa.Table, folder: Path) -> Path:
    parquet.write_table(table, folder / "log.parquet")
    return folder / "log.parquet"


def _feather(table: pa.Table, folder: Path) -> Path:
    feather.write_feather(table, folder / "log.feather")
    return folder / "log.feather"


def _units(path: Path) -> dict[str, str]:
    with open_log(path) as log:
        return dict(log.units("table"))


def _table(speed: dict[str, str], schema: dict[str, str]) -> pa.Table:
    fields = [pa.field("time_s", pa.float64()), pa.field("v", pa.float64(), metadata=speed)]
    columns = [pa.array([0.0, 0.1, 0.2]), pa.array([0.0, 1.0, 2.0])]
    return pa.table(columns, schema=pa.schema(fields, metadata=schema))


@pytest.mark.parametrize("write", [_parquet, _feather])
@pytest.mark.parametrize(
    ("speed", "schema"),
    [
        ({"unit": "km/h"}, {}),
        ({"units": "kmh"}, {}),
        ({}, {"v.unit": "km/h"}),
        ({}, {"unit:v": "km/h"}),
        ({}, {"units": json.dumps({"v": "km/h"})}),
        ({}, {"PANDAS_ATTRS": json.dumps({"units": {"v": "km/h"}})}),
        ({}, {"PANDAS_ATTRS": json.dumps({"v": {"unit": "km/h"}})}),
        ({}, {"pandas": json.dumps({"columns": [{"name": "v", "metadata": {"unit": "km/h"}}]})}),
        # what a field states goes before what the file does
        ({"unit": "km/h"}, {"units": json.dumps({"v": "m/s"})}),
    ],
)
def test_a_unit_in_the_metadata_is_used(
    write: Callable[[pa.Table, Path], Path],
    speed: dict[str, str],
    schema: dict[str, str],
    tmp_path: Path,
) -> None:
    assert _units(write(_table(speed, schema), tmp_path))["v"] == "km/h"


def test_the_attributes_of_a_pandas_frame_are_used(tmp_path: Path) -> None:
    frame = pd.DataFrame({"time_s": [0.0, 0.1], "v": [0.0, 1.0]})
    frame.attrs["units"] = {"v": "km/h"}
    frame.to_parquet(tmp_path / "log.parquet")
    assert _units(tmp_path / "log.parquet")["v"] == "km/h"


@pytest.mark.parametrize(
    "text", ["", "{", "[1, 2]", '{"v": 3}', '{"v": "parsec per shift"}', "[" * 100_000]
)
def test_metadata_that_state_no_unit_are_passed_over(text: str) -> None:
    keys = ("units", "PANDAS_ATTRS", "pandas")
    assert find_schema_units(dict.fromkeys(keys, text), ["v"]) == {}
