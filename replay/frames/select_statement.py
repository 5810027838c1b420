"""Run a single SELECT over named tables by polars; all other SQL is rejected before it runs."""

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Final

import polars as pl

from estimators.errors import QueryError, join_first_names, suggest_choice
from replay.frames.frame_limits import LIMITS

#: Functions that make tables, by name; called for those that a statement names.
Tables = Mapping[str, Callable[[], pl.LazyFrame]]

_TOKEN: Final = re.compile(
    r"""'(?:[^']|'')*'|"(?:[^"]|"")*"|`[^`]*`|--[^\n]*|/\*.*?\*/|[()]|\w+|\S""", re.DOTALL
)
_COMMENTS: Final = ("--", "/*")
_AFTER_ORDER: Final = ("LIMIT", "OFFSET", "FETCH")
#: First tokens of statements that only read tables.
_READING: Final = ("SELECT", "WITH", "FROM", "VALUES", "(", "EXPLAIN")
#: Functions that read files, searched in the whole text, since only the parser recognises literals.
_FILE_FUNCTION: Final = re.compile(r"\b((?:read|scan)_\w+)[\"`\]]?\s*(?:\(|/\*|--)", re.IGNORECASE)
#: Words after which polars does not keep the order of rows.
_REORDERING: Final = ("JOIN", "GROUP", "DISTINCT", "UNION", "INTERSECT", "EXCEPT", "ORDER")
_UNSORTABLE: Final = pl.Object, pl.Struct, pl.List, pl.Array


def run_select_in_stable_order(
    sql: str, tables: Tables, *, is_always_ordered: bool = False
) -> pl.LazyFrame:
    """Run a SELECT lazily, with a reproducible order of rows.

    Polars does not keep the order through joins and groups, so rows that ORDER BY leaves equal, or
    all rows without it, are ordered by every column from the left.

    Args:
        sql: one statement in the dialect of polars.
        tables: tables by name; only those in the statement are created.
        is_always_ordered: whether to order rows even if they keep their table's order.

    Raises:
        QueryError: a table or column is unknown, the SQL is invalid, or does more than read.
    """
    query = strip_statement_terminator(sql)
    frames = {name: tables[name]() for name in _list_used_table_names(query, tables)}
    with pl.SQLContext(frames=frames, eager=False) as context:
        try:
            found = context.execute(query)
            columns = found.collect_schema()
            words = {token.upper() for token in _tokenise_sql(query)}
            if words.isdisjoint(_REORDERING) and not is_always_ordered:
                return found
            by = [f'"{n}"' for n, dtype in columns.items() if not isinstance(dtype, _UNSORTABLE)]
            return context.execute(add_order_by_all_columns(query, by))
        except pl.exceptions.PolarsError as error:
            raise convert_to_query_error(error, tables) from None


def convert_to_query_error(error: pl.exceptions.PolarsError, tables: Tables) -> QueryError:
    """Convert a polars error in a SQL statement to an error of one line."""
    said = str(error).strip().partition("\n")[0]
    unknown = re.search(r"relation '(.*)' was not found", said)
    if unknown:
        return QueryError(
            f"query: no table '{unknown[1]}'; {describe_available_tables(unknown[1], tables)}"
        )
    return QueryError(f"query: {said}")


def strip_statement_terminator(sql: str) -> str:
    """Remove the terminator of a statement, and check that it only reads tables.

    Raises:
        QueryError: it is not a statement that only reads tables.
    """
    query = sql.strip().rstrip(";").strip()
    first = next(iter(_tokenise_sql(query)), "")
    if first.upper() not in _READING:
        fault = f"'{first}' is not a SELECT; a query only reads tables" if first else "it is empty"
        raise QueryError(f'query: {fault}; write "SELECT … FROM …"')  # noqa: S608 - a message
    function = _FILE_FUNCTION.search(query)
    if function:
        raise QueryError(
            f"query: {function[1]} reads files itself; name the file before the SELECT instead"
        )
    return query


def find_quoted_names(sql: str) -> list[str]:
    """Find the names in double quotes."""
    return [
        t[1:-1].replace('""', '"') for t in _tokenise_sql(sql) if t.startswith('"') and len(t) > 2
    ]


def _tokenise_sql(sql: str) -> list[str]:
    found = [token[0] for token in _TOKEN.finditer(sql)]
    return [token for token in found if not token.startswith(_COMMENTS)]


def _list_used_table_names(sql: str, tables: Tables) -> list[str]:
    """List the names of the tables that occur in a query."""
    tokens = _tokenise_sql(sql)
    words = {token.strip('"`').replace('""', '"') for token in tokens}
    named = [name for name in tables if name in words]
    if not named:
        upper = [token.upper() for token in tokens]
        if "FROM" not in upper[:-1]:
            raise QueryError(f"query: names no table; tables: {_format_list_of_tables(tables)}")
        unknown = tokens[upper.index("FROM") + 1].strip('"`')
        raise QueryError(
            f"query: no table '{unknown}'; {describe_available_tables(unknown, tables)}"
        )
    return named


def describe_available_tables(missing_name: str, tables: Tables) -> str:
    """Suggest the table name nearest to a missing one, if any, and list the tables."""
    meant = suggest_choice(missing_name, tables)
    listed = f"tables: {_format_list_of_tables(tables)}"
    return f"{meant} {listed}" if meant.endswith("?") else listed


def _format_list_of_tables(tables: Tables) -> str:
    return join_first_names(list(tables), LIMITS.max_names)


def add_order_by_all_columns(sql: str, columns: Sequence[str]) -> str:
    """Append every column to the ORDER BY of a query.

    Args:
        sql: a SELECT.
        columns: column names of its result, quoted for SQL.
    """
    depth, order, end = 0, False, len(sql)
    before = ""
    for token in _TOKEN.finditer(sql):
        word = token[0].upper()
        if word.startswith(_COMMENTS):
            continue
        depth += {"(": 1, ")": -1}.get(word, 0)
        if depth == 0 and word == "BY" and before == "ORDER":
            order, end = True, len(sql)
        elif depth == 0 and word in _AFTER_ORDER and end == len(sql):
            end = token.start()
        before = word
    if not columns:
        return sql
    head, tail = sql[:end].rstrip(), sql[end:]
    # after a comment up to the end of the line, the order would be part of the comment
    gap = "\n" if "--" in head else ""
    return f"{head}{gap}{',' if order else ' ORDER BY'} {', '.join(columns)} {tail}".strip()
