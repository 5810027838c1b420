"""The fingerprint of a run: SHA-256 digests of its inputs, its settings and its results.

The same input and settings give the same results bit for bit, on any number of threads: equal
digests of inputs and settings but different digests of results mean different software or another
processor. A digest does not depend on paths, file names, the time of the replay, the chunks in
which polars or Arrow store a column, or the byte order of the machine.
"""

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict

from analysis.model.model_limits import LIMITS


class Fingerprint(BaseModel):
    """Digests of a run, in hexadecimal digits."""

    model_config = ConfigDict(frozen=True)

    #: Digest of the contents of the input files, whatever their order.
    inputs: str
    #: Digest of the machine file as resolved, with every setting.
    settings: str
    #: Digest of all frames, in their order.
    results: str
    #: Digest of each frame by its name, in the order of the run.
    frames: dict[str, str] = {}

    def __str__(self) -> str:
        """The three digests, abbreviated for comparison by eye."""
        parts = {"inputs": self.inputs, "settings": self.settings, "results": self.results}
        return "  ".join(
            f"{name} {digest[: LIMITS.compared_digits]}" for name, digest in parts.items()
        )


def make_run_fingerprint(
    frames: Mapping[str, pl.DataFrame],
    inputs: Iterable[str],
    machine: Mapping[str, Any],
    settings: Mapping[str, Any],
) -> Fingerprint:
    """Compute the fingerprint of a run.

    Args:
        frames: frames by name, in the order of the run.
        inputs: the SHA-256 digest of each input file.
        machine: resolved machine file, as JSON-compatible values.
        settings: settings of the replay, as JSON-compatible values.
    """
    digests = {name: digest_frame(frame) for name, frame in frames.items()}
    return Fingerprint(
        inputs=_digest_json(sorted(inputs)),
        settings=_digest_json([machine, settings]),
        results=_digest_json(list(digests.items())),
        frames=digests,
    )


def digest_frame(frame: pl.DataFrame) -> str:
    """Digest of a frame: its height, and name, dtype, values and nulls of each column in order.

    Values are compared bit for bit: 0.0 differs from -0.0, and so do NaNs with different bits. The
    memory behind a null is ignored.
    """
    if frame.height < LIMITS.threaded_rows:
        columns = list(map(_digest_column_values, frame.get_columns()))
    else:
        with ThreadPoolExecutor() as pool:  # hashlib releases the interpreter's lock
            columns = list(pool.map(_digest_column_values, frame.get_columns()))
    return _digest_json([frame.height, columns])


def _digest_json(value: Any) -> str:
    text = json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def _digest_column_values(series: pl.Series) -> str:
    values, nulls = hashlib.sha256(), hashlib.sha256()
    for part in (
        series[start : start + LIMITS.hashed_rows]
        for start in range(0, series.len(), LIMITS.hashed_rows)
    ):
        if series.null_count():
            nulls.update(np.packbits(part.is_null().to_numpy()).data)
        for array in iter_value_arrays(part):
            values.update(np.ascontiguousarray(array, array.dtype.newbyteorder("<")).data)
    about = [series.name, *_convert_dtype_to_json(series.dtype)]
    return _digest_json([about, values.hexdigest(), nulls.hexdigest()])


def _convert_dtype_to_json(dtype: pl.DataType) -> list[Any]:
    if isinstance(dtype, pl.Enum):
        return ["Enum", dtype.categories.to_list()]
    return [str(dtype)]


def iter_value_arrays(series: pl.Series) -> Iterator[NDArray[Any]]:
    """Yield the values of a column as arrays, zero or empty for nulls."""
    dtype = series.dtype
    if isinstance(dtype, pl.Enum):
        # polars stores a code in as few bytes as the categories need
        yield _fill_null(series.to_physical().cast(pl.UInt32), 0).to_numpy()
    elif dtype.is_integer() or dtype.is_float():
        yield _fill_null(series, 0).to_numpy()
    elif dtype == pl.Boolean:
        yield np.packbits(_fill_null(series, fill_value=False).to_numpy())
    elif dtype.is_temporal():
        yield from iter_value_arrays(series.to_physical())
    else:
        texts = series if dtype == pl.String else _format_values_as_text(series)
        encoded = "".join(_fill_null(texts, "").to_list()).encode()
        yield _fill_null(texts.str.len_bytes().cast(pl.UInt64), 0).to_numpy()
        yield np.frombuffer(encoded, np.uint8)


def _fill_null(values: pl.Series, fill_value: float | str) -> pl.Series:
    """Fill nulls, if any; a polars query takes longer than a small column."""
    return values.fill_null(fill_value) if values.null_count() else values


def _format_values_as_text(values: pl.Series) -> pl.Series:
    """Convert a dtype that recordings do not hold (nested, binary, decimal) to text."""
    written = [None if value is None else repr(value) for value in values.to_list()]
    return pl.Series(values.name, written, dtype=pl.String)
