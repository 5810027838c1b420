"""A SELECT over tables: its order is made whole where polars keeps none."""

import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st

from replay.frames.select_statement import add_order_by_all_columns


@pytest.mark.parametrize(
    ("sql", "whole"),
    [
        ("SELECT a FROM t", 'SELECT a FROM t ORDER BY "a"'),
        ("SELECT a FROM t LIMIT 3", 'SELECT a FROM t ORDER BY "a" LIMIT 3'),
        ("SELECT a FROM t ORDER BY b DESC", 'SELECT a FROM t ORDER BY b DESC, "a"'),
        (
            "SELECT a FROM t order by b limit 2 offset 1",
            'SELECT a FROM t order by b, "a" limit 2 offset 1',
        ),
        (
            "WITH x AS (SELECT a FROM t ORDER BY a LIMIT 5) SELECT a FROM x",
            'WITH x AS (SELECT a FROM t ORDER BY a LIMIT 5) SELECT a FROM x ORDER BY "a"',
        ),
        ("SELECT 'order by' AS a FROM t", "SELECT 'order by' AS a FROM t ORDER BY \"a\""),
    ],
)
def test_the_order_is_made_whole(sql: str, whole: str) -> None:
    assert add_order_by_all_columns(sql, ['"a"']).strip() == whole


@given(st.lists(st.tuples(st.integers(0, 2), st.integers(0, 2)), min_size=1, max_size=30))
def test_rows_that_order_by_leaves_equal_are_in_one_order(rows: list[tuple[int, int]]) -> None:
    said = []
    for shuffled in (rows, rows[::-1]):
        frame = pl.DataFrame(shuffled, schema=["a", "b"], orient="row")
        context = pl.SQLContext(t=frame, eager=True)
        said.append(
            context.execute(
                add_order_by_all_columns("SELECT a, b FROM t ORDER BY a DESC", ['"a"', '"b"'])
            )
        )
    assert said[0].equals(said[1])
