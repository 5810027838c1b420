"""Which time range a filter asks for."""

from datetime import UTC, date, datetime
from operator import eq, ge, gt, le, lt
from typing import Any

import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st

from replay.frames.predicate import FIRST_NS, LAST_NS, TimeRange, bound_log_times_by_predicate

when = pl.col("t")
DAY_NS = 86_400 * 10**9


@pytest.mark.parametrize(
    ("predicate", "first", "last"),
    [
        (when >= 5, 5, LAST_NS),
        (when > 5, 6, LAST_NS),
        (pl.lit(5) > when, FIRST_NS, 4),
        (when == 5, 5, 5),
        ((when >= 5) & (pl.col("x") > 1) & (when < 9), 5, 8),
        (((when >= 5) & (when < 7)) | ((when >= 20) & (when < 30)), 5, 29),
        ((when >= 5) | (pl.col("x") > 1), FIRST_NS, LAST_NS),
        (when.is_between(2, 4), 2, 4),
        (when.is_between(2, 4, closed="none"), 3, 3),
        (~(when > 5), FIRST_NS, LAST_NS),
        (when * 2 > 5, FIRST_NS, LAST_NS),
        (when > pl.col("x"), FIRST_NS, LAST_NS),
        (when > pl.lit(None), FIRST_NS, LAST_NS),
        (when >= 2.5, 2, LAST_NS),
        (when >= date(1970, 1, 2), DAY_NS, LAST_NS),
        (when <= datetime(1970, 1, 2, tzinfo=UTC), FIRST_NS, DAY_NS),
        (when >= datetime(9000, 1, 1, tzinfo=UTC), FIRST_NS, LAST_NS),
        (when.cast(pl.Datetime("us")) > datetime(1970, 1, 2), DAY_NS - 1000, LAST_NS),
        (when >= pl.lit(3) + pl.lit(4), 7, LAST_NS),
    ],
)
def test_a_range_is_found_in_the_tree(predicate: pl.Expr, first: int, last: int) -> None:
    assert bound_log_times_by_predicate(predicate, "t") == TimeRange(first, last)


leaf = st.builds(
    lambda compare, limit, mirrored: compare(limit, when) if mirrored else compare(when, limit),
    st.sampled_from([ge, gt, le, lt, eq]),
    st.integers(-3, 13).map(pl.lit),
    st.booleans(),
) | st.builds(
    lambda low, more, closed: when.is_between(low, low + more, closed=closed),
    *(st.integers(0, 9), st.integers(0, 5), st.sampled_from(["both", "left", "right", "none"])),
)
trees: Any = st.recursive(
    leaf | st.sampled_from([pl.col("x") > 3, when.is_null()]),
    lambda inner: (
        st.builds(lambda a, b: a & b, inner, inner)
        | st.builds(lambda a, b: a | b, inner, inner)
        | inner.map(lambda a: ~a)
    ),
    max_leaves=6,
)


@given(trees)
def test_no_row_that_a_filter_keeps_is_outside_its_range(predicate: pl.Expr) -> None:
    rows = pl.DataFrame({"t": range(11), "x": [7, 1] * 5 + [7]})
    kept = rows.filter(predicate)["t"]
    within = bound_log_times_by_predicate(predicate, "t")
    assert kept.is_between(within.first_ns, within.last_ns).all()


def test_sql_and_polars_reach_the_source_alike() -> None:
    from polars.io.plugins import register_io_source

    ranges: list[TimeRange] = []
    schema = pl.Schema({"t": pl.Datetime("ns", "UTC"), "x": pl.Int64()})

    def rows(columns: Any, predicate: Any, *_: Any) -> Any:
        ranges.append(bound_log_times_by_predicate(predicate, "t"))
        frame = pl.DataFrame({"t": [0], "x": [1]}, schema=schema).filter(predicate)
        yield frame if columns is None else frame.select(columns)

    lazy = register_io_source(rows, schema=schema)
    begin, end = datetime(1970, 1, 2, tzinfo=UTC), datetime(1970, 1, 3, tzinfo=UTC)
    lazy.filter((when >= begin) & (when < end)).select("x").collect()
    context = pl.SQLContext(log=lazy)
    context.execute("SELECT x FROM log WHERE t >= '1970-01-02' AND t < '1970-01-03'").collect()
    assert ranges == [TimeRange(DAY_NS, 2 * DAY_NS - 1)] * 2
