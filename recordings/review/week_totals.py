"""Sum reviewed shifts by day, machine and product, from their ledgers and verdicts."""

import math
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

import polars as pl

from analysis.cycles.shift_totals import make_totals_of_counted_cycles
from analysis.model.physical_units import NS
from estimators.errors import ReviewError
from recordings.review.review_state import ReviewState, read_review_state
from recordings.review.reviewer_verdicts import assign_verdicts_to_rows, read_verdict_file
from recordings.review.shift_ledger import PARQUET, read_cycle_rows_of_review

#: Of a second, in ns.
NO_DATE: Final = "no date"
GROUPS: Final = ("day", "machine", "product")
#: Group of the loads of one folder.
BY_REVIEW: Final = "review"


class WeekPart(NamedTuple):
    """Loads of one product, day, machine and review.

    Attributes:
        day: day on which the loads end, by the machine's clock.
        machine: name and serial number of the machine.
        product: product; empty if none was named.
        loads: number of counted loads.
        payload_kg: sum of payloads.
        random_u_kg: random part of the sum's standard uncertainty.
        common_u_kg: part of the sum's standard uncertainty common to all loads of the machine.
        rejected: number of loads rejected by a reviewer.
        noted: number of loads with another verdict.
        energy_kWh: energy of the counted loads with known energy.
        energy_u_kWh: standard uncertainty of that energy.
        energy_t: tonnes of the loads with known energy.
        is_scale_known: whether the uncertainty includes the scale error.
        review: folder of the review.
    """

    day: str
    machine: str
    product: str
    loads: int
    payload_kg: float
    random_u_kg: float
    common_u_kg: float
    rejected: int = 0
    noted: int = 0
    energy_kWh: float = 0.0
    energy_u_kWh: float = 0.0
    energy_t: float = 0.0
    is_scale_known: bool = True
    review: str = ""


class WeekTotal(NamedTuple):
    """Totals of one day, machine or product.

    Attributes:
        name: name of the group; empty for loads without a product.
        loads: number of counted loads.
        payload_kg: sum of payloads.
        payload_u_kg: standard uncertainty of that sum.
        rejected: number of loads rejected by a reviewer.
        noted: number of loads with another verdict: a product, a note.
        kWh_per_t: energy per tonne; None if unknown.
        kWh_per_t_u: standard uncertainty of the energy per tonne; None if unknown.
    """

    name: str
    loads: int
    payload_kg: float
    payload_u_kg: float
    rejected: int
    noted: int
    kWh_per_t: float | None
    kWh_per_t_u: float | None


def read_counted_loads_of_reviews(review_folders: Sequence[Path]) -> list[WeekPart]:
    """Read the counted loads of reviews, with the current `verdicts.toml`, without a replay.

    A load belongs to the day on which it ends, by the clock of its machine.

    Raises:
        ReviewError: a folder has no review of this version, its ledger was changed, or two folders
            have the same load.
    """
    owners: dict[tuple[str, int], Path] = {}
    found: list[WeekPart] = []
    for folder in review_folders:
        state = read_review_state(folder)
        if state is None or not (folder / PARQUET).is_file():
            raise ReviewError(
                f"{folder}: holds no review of this version; create one with payscope review LOG… "
                f"-m MACHINE -o {folder}"
            )
        try:
            rows, cycles = read_cycle_rows_of_review(folder, state)
        except OSError as error:
            raise ReviewError(
                f"{folder / PARQUET}: cannot be read ({error.strerror}); review its logs again"
            ) from None
        except pl.exceptions.PolarsError:
            raise ReviewError(
                f"{folder / PARQUET}: is not a ledger of this version; review its logs again"
            ) from None
        machine = format_machine_title(state)
        for ends_ns in rows["end_unix_ns"] if state.clock.has_date else ():
            other = owners.get((machine, ends_ns))
            if other is not None:
                raise ReviewError(
                    f"{folder}: contains loads that are also in {other}; give only one of the two "
                    "folders"
                )
        owners |= {(machine, ends_ns): folder for ends_ns in rows["end_unix_ns"]}
        found += _sum_loads_by_material_and_day(rows, cycles, state, folder)
    return found


def format_machine_title(state: ReviewState) -> str:
    """Format name and serial number of a machine."""
    return f"{state.machine} {state.serial}".strip()


def _sum_loads_by_material_and_day(
    ledger_rows: pl.DataFrame, cycles: pl.DataFrame, state: ReviewState, folder: Path
) -> list[WeekPart]:
    verdicts = read_verdict_file(folder)
    by_row = assign_verdicts_to_rows(verdicts, ledger_rows["id"], folder)
    rejected = [int(ledger_rows["cycle"][row]) for row, each in by_row.items() if each.reject]
    clock = state.clock
    groups: dict[tuple[str, str], list[int]] = defaultdict(list)
    for row, ends_ns in enumerate(ledger_rows["end_unix_ns"]):
        own = by_row[row].product if row in by_row else ""
        local = (
            clock.to_local_datetime((ends_ns - state.t0_unix_ns) / NS) if clock.has_date else None
        )
        day = NO_DATE if local is None else f"{local:%Y-%m-%d}"
        groups[day, own or verdicts.find_labels_at_dump(ends_ns / NS).product].append(row)
    parts: list[WeekPart] = []
    for (day, product), members in groups.items():
        sums = make_totals_of_counted_cycles(cycles[members], rejected)
        masses = (sums[f"payload_{name}kg"] for name in ("", "u_random_", "u_common_"))
        members_counted = cycles[members].filter("counted")
        given = [row for row in members if row in by_row]
        parts.append(
            WeekPart(
                day,
                format_machine_title(state),
                product,
                sums["cycles_counted"],
                *masses,
                rejected=sum(by_row[row].reject for row in given),
                noted=sum(not by_row[row].reject for row in given),
                is_scale_known=not (members_counted["scale_from"] == "").any(),
                review=str(folder),
                **sum_energy_of_counted_loads(ledger_rows[members], cycles[members], rejected),
            )
        )
    return parts


def sum_energy_of_counted_loads(
    ledger_rows: pl.DataFrame, cycles: pl.DataFrame, rejected_rows: Sequence[int]
) -> dict[str, float]:
    """Sum the energy of counted loads with known energy; its errors are common to all loads."""
    known = ledger_rows.with_columns(counted=cycles["counted"]).filter(
        pl.col("counted"), ~pl.col("cycle").is_in(rejected_rows), pl.col("energy_kWh").is_not_null()
    )
    return {
        "energy_kWh": float(known["energy_kWh"].sum()),
        "energy_u_kWh": float(known["energy_u_kWh"].sum()),
        "energy_t": float(known["payload_kg"].sum()) / 1e3,
    }


def sum_week_parts_by_group(week_parts: Sequence[WeekPart], group_name: str) -> list[WeekTotal]:
    """Sum the parts of a week by one of `GROUPS`, in alphabetical order.

    Errors common to the loads of a machine are common to all its shifts and add linearly; machines
    are independent.

    Args:
        week_parts: parts of the week.
        group_name: name of the group, or `BY_REVIEW`.
    """
    members: dict[str, list[WeekPart]] = defaultdict(list)
    for part in week_parts:
        members[getattr(part, group_name)].append(part)
    return [_sum_week_parts(name, members[name]) for name in sorted(members)]


def sum_week(week_parts: Sequence[WeekPart]) -> WeekTotal:
    """Sum the whole week."""
    return _sum_week_parts("all", week_parts)


def _sum_week_parts(total_name: str, week_parts: Sequence[WeekPart]) -> WeekTotal:
    """Sum several parts; common errors add linearly within a machine."""
    common_kg: dict[str, float] = defaultdict(float)
    for part in week_parts:
        common_kg[part.machine] += part.common_u_kg
    u_kg = math.hypot(*(part.random_u_kg for part in week_parts), *common_kg.values())
    mass_kg = math.fsum(part.payload_kg for part in week_parts)
    loads, rejected, noted = (
        sum(getattr(part, count) for part in week_parts) for count in ("loads", "rejected", "noted")
    )
    per_t, per_t_u = compute_week_energy_per_tonne(week_parts, mass_kg, u_kg)
    return WeekTotal(total_name, loads, mass_kg, u_kg, rejected, noted, per_t, per_t_u)


class EnergyPerTonne(NamedTuple):
    """Energy per tonne with its standard uncertainty; None if unknown."""

    kWh_per_t: float | None
    u_kWh_per_t: float | None


def compute_week_energy_per_tonne(
    week_parts: Sequence[WeekPart], mass_kg: float, mass_u_kg: float
) -> EnergyPerTonne:
    """Compute energy per tonne and its standard uncertainty; None without known energy."""
    energy_kWh, tonnes = (
        math.fsum(getattr(part, name) for part in week_parts) for name in ("energy_kWh", "energy_t")
    )
    if tonnes <= 0.0 or mass_kg <= 0.0:
        return EnergyPerTonne(None, None)
    own_kWh: dict[str, float] = defaultdict(float)
    for part in week_parts:
        own_kWh[part.machine] += part.energy_u_kWh
    per_t = energy_kWh / tonnes
    return EnergyPerTonne(
        per_t, math.hypot(math.hypot(*own_kWh.values()) / tonnes, per_t * mass_u_kg / mass_kg)
    )
