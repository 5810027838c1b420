"""One pass over a batch: walk some messages, gather their values at fixed offsets, and repeat.

About a thousand messages fit into the processor's fast caches, and are still cached when their
columns are gathered; a whole batch does not fit.
"""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.arrays import Bytes, Ints
from estimators.interpreted import compiled_without_refcounts
from replay.logs.decoding.direct_fields import GatherPlan
from replay.logs.decoding.gather_values import (
    copy_ranges_of_equal_size,
    fill_string_views,
    load_64_bit_patterns,
)
from replay.logs.decoding.walk_program import (
    EncodedMessages,
    Encoding,
    LayoutTemplate,
    WalkNotes,
    WalkOutcome,
    locate_fields_in_messages,
)

#: Messages that are walked before their values are gathered.
_ROWS_AT_ONCE: Final = 1024


class GatheredRows(NamedTuple):
    """Memory for gathered rows, filled from the first on, one per complete message."""

    #: (values, n) 64-bit patterns
    values: Ints
    #: the arrays one after the other, n rows of each
    arrays: Bytes
    #: (texts, n, 4) views of strings, and the bytes of those that do not fit into their views
    views: NDArray[np.uint32]
    long_bytes: Ints
    #: (texts, n, 16) the bytes of `views`
    characters: Bytes
    #: empty output for text that is not kept
    nowhere: Bytes


def allocate_gathered_rows(gather_plan: GatherPlan, row_count: int) -> GatheredRows:
    """Allocate memory for `row_count` rows."""
    texts = gather_plan.text_marks.size
    views = np.empty((texts, row_count, 4), np.uint32)
    return GatheredRows(
        np.empty((gather_plan.value_marks.size, row_count), np.int64),
        np.empty(int(gather_plan.array_bytes.sum()) * row_count, np.uint8),
        views,
        np.zeros(texts, np.int64),
        views.view(np.uint8),
        np.empty(0, np.uint8),
    )


@compiled_without_refcounts
def locate_and_gather_fields(
    messages: EncodedMessages,
    encoding: Encoding,
    steps: Ints,
    walk_notes: WalkNotes,
    template: LayoutTemplate,
    gather_plan: GatherPlan,
    gathered_rows: GatheredRows,
    outcome: WalkOutcome,
) -> None:
    """Locate the fields of messages, and gather those of the gather plan.

    Args:
        messages: all messages.
        encoding: their encoding.
        steps: the program.
        walk_notes: receives the marks.
        template: memory for a template, initially empty.
        gather_plan: plan of the gathered values.
        gathered_rows: receives the values.
        outcome: receives the outcome of each message.
    """
    filled = walk_notes.filled
    count = messages.begins.size
    for first in range(0, count, _ROWS_AT_ONCE):
        row = filled[0]
        end = min(first + _ROWS_AT_ONCE, count)
        locate_fields_in_messages(
            messages, first, end, encoding, steps, walk_notes, template, outcome
        )
        _gather_columns(
            messages.data, walk_notes, gather_plan, gathered_rows, encoding.swap, row, filled[0]
        )


@compiled_without_refcounts
def _gather_columns(
    data: Bytes,
    walk_notes: WalkNotes,
    gather_plan: GatherPlan,
    gathered_rows: GatheredRows,
    swap: bool,
    first: int,
    end: int,
) -> None:
    """Gather values, arrays and strings of the complete messages `first` to `end`."""
    table, marks, _, _, _ = walk_notes
    value_marks, value_offsets, value_loads = gather_plan[:3]
    array_marks, array_offsets, array_bytes, text_marks = gather_plan[3:]
    values, arrays, views, long_bytes, characters, nowhere = gathered_rows
    for k in range(value_marks.size):
        base = table[value_marks[k], 1]
        positions = marks[base + first : base + end]
        load_64_bit_patterns(
            data, positions, value_offsets[k], value_loads[k], swap, values[k, first:end]
        )
    rows = values.shape[1]
    above = 0
    for k in range(array_marks.size):
        base, size = table[array_marks[k], 1], array_bytes[k]
        positions = marks[base + first : base + end]
        out = arrays[above + first * size : above + end * size]
        copy_ranges_of_equal_size(data, positions, array_offsets[k], size, out)
        above += rows * size
    for k in range(text_marks.size):
        base, sizes = table[text_marks[k], 1], table[text_marks[k] + 1, 1]
        long_bytes[k] += fill_string_views(
            data,
            marks[base + first : base + end],
            marks[sizes + first : sizes + end],
            views[k, first:end],
            characters[k, first:end],
            nowhere,
        )
