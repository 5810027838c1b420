"""The command `fleet query`: SQL over all results, its rows in an order that is always the same."""

from functools import partial

import polars as pl

from analysis.fleet.fleet_tables import TABLES
from replay.fleet.gathered_tables import FleetResults
from replay.frames.select_statement import Tables, query_fault, select_rows


def fleet_tables(results: FleetResults) -> Tables:
    """The tables of a fleet's results, by name."""
    return {name: partial(results.scan, name) for name in TABLES}


def fleet_query(results: FleetResults, sql: str) -> pl.DataFrame:
    """Run a query over the tables of a fleet.

    Args:
        results: of a fleet.
        sql: one SELECT, as polars reads it.

    Raises:
        QueryError: no such table or column, or no SELECT.
    """
    tables = fleet_tables(results)
    try:
        return select_rows(sql, tables, always_ordered=True).collect()
    except pl.exceptions.PolarsError as error:
        raise query_fault(error, tables) from None
