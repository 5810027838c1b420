"""Read a fleet's results as tables, gathered by machine, since thousands of small files are slow.

Gathered tables are derived: `gathered/machine=M/DIGEST/TABLE.parquet` holds the rows of all results
of a machine, in the order of their logs, and DIGEST is the digest of their keys. If it is missing
or the keys differ, it is rebuilt from the previous gathered table and the new results.
"""

import hashlib
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Final
from urllib.parse import quote

import polars as pl
from pydantic import ValidationError

from analysis.fleet.calibration_steps import FleetCalibration
from analysis.fleet.fleet_tables import TABLES, make_table_schema
from analysis.model.check_names import rename_stored_checks
from estimators.errors import FleetError, OutputError
from replay.fleet.last_run import CALIBRATIONS, CURRENT, FAILED, LastRun
from replay.fleet.object_store import ObjectStore
from replay.fleet.results_layout import (
    MARK,
    ResultName,
    encode_compressed_parquet_table,
    parse_result_name,
)
from replay.frames.select_statement import (
    Tables,
    convert_to_query_error,
    run_select_in_stable_order,
)

_GATHERED: Final = "gathered"
#: Hexadecimal digits of a digest that distinguish sets of results.
_DIGITS: Final = 16
_ORDER: Final = ("t0_unix_ns", "key")


@dataclass
class FleetResults:
    """Results of a fleet at a destination.

    Attributes:
        store: storage of the results.
    """

    store: ObjectStore

    @cached_property
    def result_names_by_machine(self) -> Mapping[str, Sequence[ResultName]]:
        """Existing results of every machine, by day and key."""
        found: dict[str, list[ResultName]] = {}
        for each in self.store.list_names(MARK):
            name = parse_result_name(each)
            if name is not None:
                found.setdefault(name.machine, []).append(name)
        return {machine: sorted(found[machine]) for machine in sorted(found)}

    @cached_property
    def _gathered_folder_by_machine(self) -> Mapping[str, str]:
        """Folder of the current gathered tables by machine; missing ones are made."""
        there: dict[str, list[str]] = {}
        for each in self.store.list_names(_GATHERED):
            folder, _, name = each.rpartition("/")
            if name == f"{MARK}.parquet":  # written last: the others are complete
                there.setdefault(folder.rpartition("/")[0], []).append(folder)
        found: dict[str, str] = {}
        for machine, names in self.result_names_by_machine.items():
            home = f"{_GATHERED}/machine={quote(machine, safe='')}"
            wanted = f"{home}/{_digest_result_names(names)}"
            old = there.get(home, [])
            if wanted not in old:
                self._gather_tables_of_machine(wanted, names, old)
            found[machine] = wanted
        return found

    def update_gathered_tables(self) -> None:
        """Make the gathered tables that are missing or outdated."""
        _ = self._gathered_folder_by_machine

    def _gather_tables_of_machine(
        self, folder: str, names: Sequence[ResultName], old_names: Sequence[str]
    ) -> None:
        """Gather the results of one machine into tables, reusing its previous gathered tables."""
        keys = {name.key for name in names}
        known: set[str] = set()
        base = ""
        for each in old_names:
            held = set(self._read_gathered_table(f"{each}/{MARK}.parquet")["key"])
            if held <= keys and len(held) >= len(known):
                base, known = each, held
        new = [name for name in names if name.key not in known]
        for table in TABLES:
            parts = self.store.iter_object_contents_or_none(
                name.make_object_name_of_table(table) for name in new
            )
            frames = [pl.read_parquet(io.BytesIO(part)) for part in parts if part is not None]
            if base:
                frames.insert(0, self._read_gathered_table(f"{base}/{table}.parquet"))
            # the rows of each result keep their order
            whole = pl.concat([pl.DataFrame(schema=make_table_schema(table)), *frames])
            ordered = whole.sort(_ORDER, maintain_order=True, nulls_last=True)
            self.store.write_object(
                f"{folder}/{table}.parquet", encode_compressed_parquet_table(ordered)
            )
        self.store.delete_objects(
            [f"{each}/{table}.parquet" for each in old_names for table in TABLES]
        )

    def _read_gathered_table(self, name: str) -> pl.DataFrame:
        return pl.read_parquet(io.BytesIO(self.store.read_object(name)))

    def scan_rows_of_all_settings(self, table_name: str) -> pl.LazyFrame:
        """Scan a table of all results under any settings, ordered by machine and log."""
        files = [
            f"{folder}/{table_name}.parquet" for folder in self._gathered_folder_by_machine.values()
        ]
        if not files:
            return pl.LazyFrame(schema=make_table_schema(table_name))
        if self.store.folder is not None:
            rows = pl.scan_parquet([Path(self.store.folder, each) for each in files])
            return rename_stored_checks(table_name, rows)
        # read whole objects, since not every server supports reading a part
        parts = [
            pl.read_parquet(io.BytesIO(part)) for part in self.store.iter_object_contents(files)
        ]
        return rename_stored_checks(table_name, pl.concat(parts).lazy())

    @cached_property
    def selected_results(self) -> pl.DataFrame:
        """One row per log and machine: the result of the last run's settings, else the latest."""
        bases = [basis for each in self.last_run.machines.values() for basis in each.bases]
        return (
            self.scan_rows_of_all_settings(MARK)
            .with_columns(pl.col("basis").is_in(bases).alias("current"))
            .sort("current", "made_unix_ns", "key", descending=True)
            .unique(["machine", "log_sha256"], keep="first", maintain_order=True)
            .sort("machine", *_ORDER, nulls_last=True)
            .collect()
        )

    def scan_rows_of_selected_results(self, table_name: str) -> pl.LazyFrame:
        """Scan the rows of a table that belong to `selected_results`."""
        if table_name == MARK:
            return self.selected_results.lazy()
        rows = self.scan_rows_of_all_settings(table_name)
        if self.selected_results.height == sum(map(len, self.result_names_by_machine.values())):
            return rows
        return rows.join(self.selected_results.lazy().select("key"), on="key", how="semi")

    @cached_property
    def last_run(self) -> LastRun:
        """Options of the last run."""
        try:
            return LastRun.model_validate_json(self._read_object_or_default(CURRENT, b"{}"))
        except ValidationError:
            place = self.store.make_full_object_name(CURRENT)
            raise FleetError(
                f"{place}: was changed after payscope wrote it; run the fleet again"
            ) from None

    @cached_property
    def failure_reason_by_source(self) -> dict[str, str]:
        """Reason why a recording has no result, by source."""
        return json.loads(self._read_object_or_default(FAILED, b"{}"))

    @cached_property
    def calibrations_in_use(self) -> list[FleetCalibration]:
        """Calibrations used for the results."""
        kept = json.loads(self._read_object_or_default(CALIBRATIONS, b"[]"))
        return [FleetCalibration.model_validate(each) for each in kept]

    def _read_object_or_default(self, object_name: str, default: bytes) -> bytes:
        try:
            return self.store.read_object(object_name)
        except FileNotFoundError:
            return default

    def store_last_run(self, last_run: LastRun) -> None:
        """Store the options of the last run, which select results; other machines keep theirs."""
        machines = {**self.last_run.machines, **last_run.machines}
        now = last_run.model_copy(update={"machines": dict(sorted(machines.items()))})
        if now != self.last_run:
            self.store.write_object(CURRENT, now.model_dump_json(indent=1).encode())


def open_results_of_fleet(destination: str) -> FleetResults:
    """Open the results at a destination.

    Raises:
        FleetError: there are no results.
    """
    store = ObjectStore(destination)
    if store.folder is not None and not store.folder.is_dir():
        raise FleetError(f"{destination}: no such folder; `payscope fleet run` makes one")
    found = FleetResults(store)
    if not found.result_names_by_machine:
        raise FleetError(
            f"{destination}: has no results of a fleet; `payscope fleet run` makes them"
        )
    try:
        found.update_gathered_tables()
    except OutputError as error:
        raise FleetError(f"{destination}: its results cannot be gathered ({error})") from None
    return found


def _digest_result_names(names: Sequence[ResultName]) -> str:
    keys = "\n".join(sorted(name.key for name in names))
    tables = ",".join(TABLES)
    return hashlib.sha256(f"{tables}\n{keys}".encode()).hexdigest()[:_DIGITS]


def make_tables_of_fleet(results: FleetResults) -> Tables:
    """Make the tables of a fleet's selected results, by name, read when used."""
    return {name: partial(results.scan_rows_of_selected_results, name) for name in TABLES}


def query_fleet_tables(results: FleetResults, sql: str) -> pl.DataFrame:
    """Run a query over the tables of a fleet.

    Args:
        results: results of a fleet.
        sql: one SELECT in the dialect of polars.

    Raises:
        QueryError: unknown table or column, or not a SELECT.
    """
    tables = make_tables_of_fleet(results)
    try:
        return run_select_in_stable_order(sql, tables, is_always_ordered=True).collect()
    except pl.exceptions.PolarsError as error:
        raise convert_to_query_error(error, tables) from None
