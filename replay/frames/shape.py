"""Make the columns of a topic's frame: dotted or nested, lists or arrays, names or numbers."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, Literal, cast

import numpy as np
import polars as pl

from replay.logs.messages.message_types import LeafField, ValueNames

LOG_TIME_NS: Final = "log_time_ns"
STAMP_NS: Final = "header_stamp_ns"
LOG_TIME: Final = "log_time"
STAMP: Final = "header_stamp"
DATETIME: Final = pl.Datetime("ns", "UTC")


@dataclass(frozen=True, slots=True)
class FrameOptions:
    """Options for converting the fields of a topic to columns.

    Attributes:
        nested: `dotted` names a column by its path in the message; `struct` keeps the nesting.
        arrays: whether arrays of a fixed length are a `list` or an `array`.
        enums: whether an enumeration is the `name` of each value, or its `number`.
        times: whether log times and header stamps are a `datetime` (UTC, in ns) or `ns` (Int64).
    """

    nested: Literal["dotted", "struct"] = "dotted"
    arrays: Literal["list", "array"] = "list"
    enums: Literal["name", "number"] = "name"
    times: Literal["datetime", "ns"] = "datetime"


#: Options for columns as `Log.read` returns them.
AS_READ: Final = FrameOptions(enums="number", times="ns")


@dataclass(frozen=True, slots=True)
class FieldBranch:
    """A nested message, or a list of messages."""

    #: whether it is a list of messages
    is_list: bool
    #: length of the list; None if it varies
    length: int | None
    below: "dict[str, FieldBranch | LeafField]" = field(default_factory=dict)


class TopicShape:
    """Columns of a topic, and their construction from the fields that `Log.read` returns."""

    def __init__(self, leaves: Sequence[LeafField], options: FrameOptions) -> None:
        self._options = options
        self.leaves = {leaf.name: leaf for leaf in leaves}
        is_dated = options.times == "datetime"
        self.time = LOG_TIME if is_dated else LOG_TIME_NS
        self._own = {self.time: LOG_TIME_NS, (STAMP if is_dated else STAMP_NS): STAMP_NS}
        is_nested = options.nested == "struct"
        self._tree: dict[str, FieldBranch | LeafField] = (
            _make_field_tree(leaves) if is_nested else {leaf.name: leaf for leaf in leaves}
        )
        schema: dict[str, pl.DataType] = dict.fromkeys(
            self._own, DATETIME if is_dated else pl.Int64()
        )
        for name, node in self._tree.items():
            # a column of every topic has precedence over a field of the same name
            schema.setdefault(name, self._make_dtype_of_node(node, 0))
        self.schema = pl.Schema(schema)

    def list_fields_needed_for_columns(self, columns: Sequence[str]) -> list[str]:
        """List the fields to read for the given columns."""
        wanted = [name for name in columns if name not in self._own]
        return [leaf.name for name in wanted for leaf in _iter_leaves_below(self._tree[name])]

    def make_frame_of_columns(
        self, field_frame: pl.DataFrame, columns: Sequence[str]
    ) -> pl.DataFrame:
        """Build columns from a frame of their fields."""
        values = field_frame.to_dict()
        made = [
            values[self._own[name]].cast(self.schema[name]).alias(name)
            if name in self._own
            else self._make_column_of_node(self._tree[name], values, 0).alias(name)
            for name in columns
        ]
        return pl.DataFrame(made)

    def _make_dtype_of_node(
        self, field_node: FieldBranch | LeafField, list_depth: int
    ) -> pl.DataType:
        """Data type of a node inside `list_depth` lists."""
        if isinstance(field_node, LeafField):
            return self._make_dtype_of_leaf(field_node, list_depth)
        inside = list_depth + field_node.is_list
        record = pl.Struct(
            {
                name: self._make_dtype_of_node(below, inside)
                for name, below in field_node.below.items()
            }
        )
        return (
            self._make_list_or_array_dtype(record, field_node.length)
            if field_node.is_list
            else record
        )

    def _make_dtype_of_leaf(self, leaf: LeafField, list_depth: int) -> pl.DataType:
        dtype, lists = leaf.dtype, 0
        while isinstance(dtype, pl.List):
            dtype, lists = cast("pl.DataType", dtype.inner), lists + 1
        if self._are_values_shown_by_name(leaf):
            dtype = pl.String()
        elif leaf.is_stamp and self._options.times == "datetime":
            dtype = DATETIME
        for length in reversed((leaf.lengths or (None,) * lists)[list_depth:]):
            dtype = self._make_list_or_array_dtype(dtype, length)
        return dtype

    def _make_list_or_array_dtype(self, dtype: pl.DataType, length: int | None) -> pl.DataType:
        is_array = length is not None and self._options.arrays == "array"
        return pl.Array(dtype, length) if is_array else pl.List(dtype)

    def _are_values_shown_by_name(self, leaf: LeafField) -> bool:
        """Whether enumerated values of a leaf are shown by name."""
        return bool(leaf.value_names) and self._options.enums == "name"

    def _make_column_of_node(
        self,
        field_node: FieldBranch | LeafField,
        values_by_field: Mapping[str, pl.Series],
        list_depth: int,
    ) -> pl.Series:
        """Make the column of a node, inside `list_depth` lists, from the values of its leaves."""
        if isinstance(field_node, LeafField):
            found = values_by_field[field_node.name]
            if self._are_values_shown_by_name(field_node):
                found = replace_enumerated_values_by_names(found, field_node.value_names)
            dtype = self._make_dtype_of_leaf(field_node, list_depth)
            return found if found.dtype == dtype else found.cast(dtype)
        if not field_node.is_list:
            columns = [
                self._make_column_of_node(below, values_by_field, list_depth).alias(name)
                for name, below in field_node.below.items()
            ]
            return pl.DataFrame(columns).to_struct()
        leaves = [leaf.name for leaf in _iter_leaves_below(field_node)]
        counts = values_by_field[leaves[0]].list.len()
        flat = {name: concatenate_list_elements(values_by_field[name]) for name in leaves}
        record = self._make_column_of_node(
            FieldBranch(False, None, field_node.below), flat, list_depth + 1
        )
        return split_into_lists(record, counts).cast(
            self._make_dtype_of_node(field_node, list_depth)
        )


def _make_field_tree(leaves: Sequence[LeafField]) -> dict[str, FieldBranch | LeafField]:
    """Make a tree of the leaves by the parts of their names."""
    tree: dict[str, FieldBranch | LeafField] = {}
    for leaf in leaves:
        *way, last = leaf.name.split(".")
        here, depth = tree, 0
        for step in way:
            is_list = step.endswith("[]")
            length = leaf.lengths[depth] if is_list and depth < len(leaf.lengths) else None
            node = here.setdefault(step.removesuffix("[]"), FieldBranch(is_list, length))
            depth += is_list
            if isinstance(node, LeafField):  # a column whose name is a prefix of another's
                break
            here = node.below
        else:
            here[last.removesuffix("[]")] = leaf
    return tree


def _iter_leaves_below(node: FieldBranch | LeafField) -> Iterator[LeafField]:
    if isinstance(node, LeafField):
        yield node
    else:
        for below in node.below.values():
            yield from _iter_leaves_below(below)


def concatenate_list_elements(lists: pl.Series) -> pl.Series:
    """Concatenate the elements of all lists."""
    return pl.Series(lists.name, lists.to_arrow().flatten(), dtype=lists.dtype.inner)  # type: ignore[attr-defined]


def split_into_lists(elements: pl.Series, counts: pl.Series) -> pl.Series:
    """Split elements into lists of the given lengths; null where the length is null."""
    import pyarrow as pa  # slow to import, and only needed for lists of messages

    ends = counts.fill_null(0).cast(pl.Int64).cum_sum().to_numpy()
    offsets = pa.array(np.concatenate([np.zeros(1, np.int64), ends]))
    mask = pa.array(counts.is_null().to_numpy()) if counts.null_count() else None
    lists: Any = pa.LargeListArray.from_arrays(offsets, elements.to_arrow(), mask=mask)
    return pl.Series(elements.name, lists)


def replace_enumerated_values_by_names(values: pl.Series, value_names: ValueNames) -> pl.Series:
    """Replace enumerated values by their names, and values without a name by their digits."""
    number: pl.Expr = pl.element() if isinstance(values.dtype, pl.List) else pl.col(values.name)
    numbers, texts = zip(*value_names, strict=True)
    named = number.replace_strict(
        numbers, texts, default=number.cast(pl.String), return_dtype=pl.String
    )
    depth, dtype = 0, values.dtype
    while isinstance(dtype, pl.List):
        dtype, depth = dtype.inner, depth + 1
    for _ in range(depth - 1):
        named = pl.element().list.eval(named)
    if depth:
        named = pl.col(values.name).list.eval(named)
    return values.to_frame().select(named.alias(values.name)).to_series()
