"""The command `fleet query`: SQL over all results, its rows in an order that is always the same."""

import re
from typing import Final

import polars as pl

from analysis.fleet.fleet_tables import TABLES
from estimators.errors import FleetError, nearest
from replay.fleet.gathered_tables import FleetResults

_TOKEN: Final = re.compile(r"""'(?:[^']|'')*'|"(?:[^"]|"")*"|--[^\n]*|[()]|[A-Za-z_]+|\S""")
_AFTER: Final = ("LIMIT", "OFFSET", "FETCH")
_SORTED: Final = pl.Object, pl.Struct, pl.List, pl.Array


def fleet_query(results: FleetResults, sql: str) -> pl.DataFrame:
    """Run a query over the tables of a fleet.

    No engine keeps an order that was not asked for, so one is always asked for: rows that ORDER BY
    leaves equal, or all where there is none, are ordered by every column from the left.

    Args:
        results: of a fleet.
        sql: one SELECT, as polars reads it.

    Raises:
        FleetError: no such table or column, or no SQL.
    """
    query = sql.strip().rstrip(";").strip()
    context = pl.SQLContext(
        frames={name: results.scan(name) for name in _named(query)}, eager=False
    )
    try:
        columns = context.execute(query).collect_schema()
        by = [f'"{n}"' for n, dtype in columns.items() if not isinstance(dtype, _SORTED)]
        return context.execute(ordered(query, by)).collect()
    except pl.exceptions.PolarsError as error:
        said = str(error).strip().partition("\n")[0]
        known = f"; tables: {', '.join(TABLES)}" if "relation" in said else ""
        raise FleetError(f"query: {said}{known}") from None


def _named(query: str) -> list[str]:
    """The tables whose names are in a query: the others are not read."""
    words = set(re.findall(r"\w+", query))
    named = [name for name in TABLES if name in words]
    if not named:
        after = re.search(r"\bfrom\s+(\w+)", query, re.IGNORECASE)
        fault = f"no table '{after[1]}'; {nearest(after[1], TABLES)}" if after else "names no table"
        raise FleetError(f"query: {fault}; tables: {', '.join(TABLES)}")
    return named


def ordered(query: str, columns: list[str]) -> str:
    """The query with its order made whole.

    Args:
        query: a SELECT.
        columns: of its result, as SQL names them.
    """
    depth, order, end = 0, False, len(query)
    before = ""
    for token in _TOKEN.finditer(query):
        word = token[0].upper()
        depth += {"(": 1, ")": -1}.get(word, 0)
        if depth == 0 and word == "BY" and before == "ORDER":
            order, end = True, len(query)
        elif depth == 0 and word in _AFTER and end == len(query):
            end = token.start()
        before = word
    if not columns:
        return query
    more = ", ".join(columns)
    head, tail = query[:end].rstrip(), query[end:]
    return f"{head}{', ' if order else ' ORDER BY '}{more} {tail}".strip()
