"""Write the energy of a shift into ledger, JSON and page: columns, a table and sentences."""

from collections.abc import Mapping, Sequence
from math import floor, hypot, log10
from typing import Any, Final

import polars as pl

from analysis.cycles.cycle_energy import PARTS, PHASES, WHOLE, EnergyAmount, EnergyRow
from recordings.report.number_text import format_plus_minus
from recordings.report.shift_text import K
from recordings.review.review_limits import LIMITS
from recordings.review.review_state import ReviewState

#: Energies in the ledger, each with its standard uncertainty beside it: the whole work, its parts,
#: its phases, and the work per tonne.
ENERGIES: Final = ("energy", *PARTS[1:], *PHASES, "energy_per_t")
#: Columns of the ledger with the fuel of a cycle and its standard uncertainty.
FUEL: Final = "fuel_L"
FUEL_U: Final = "fuel_u_L"


def make_energy_column_name(energy_name: str) -> str:
    """Make the name of the ledger column of an energy."""
    return f"{energy_name}_kWh"


def make_uncertainty_column_name(energy_name: str) -> str:
    """Make the name of the ledger column of an energy's standard uncertainty."""
    return f"{energy_name}_u_kWh"


def add_energy_columns(ledger_rows: pl.DataFrame, state: ReviewState) -> pl.DataFrame:
    """Add the energy of each cycle to the ledger; null if unknown.

    Args:
        ledger_rows: the ledger.
        state: state of the review.
    """
    by_cycle: dict[int, dict[str, EnergyAmount]] = {}
    for row in state.energy.rows:
        if row.cycle is not None:
            by_cycle.setdefault(row.cycle, {}).update(read_energy_amounts(row))
    found: list[dict[str, EnergyAmount]] = []
    for ledger_row in ledger_rows.iter_rows(named=True):
        amounts = by_cycle.get(ledger_row["cycle"], {})
        if "energy" in amounts and ledger_row["counted"]:
            amounts = amounts | {
                "energy_per_t": _compute_energy_per_tonne(amounts["energy"], ledger_row)
            }
        found.append(amounts)
    columns: list[pl.Series] = []
    for name in ENERGIES:
        pairs = [each.get(name, (None, None)) for each in found]
        columns.append(
            pl.Series(make_energy_column_name(name), [p[0] for p in pairs], dtype=pl.Float64)
        )
        columns.append(
            pl.Series(make_uncertainty_column_name(name), [p[1] for p in pairs], dtype=pl.Float64)
        )
    burnt = {row.cycle: row.fuel_L for row in state.energy.rows if row.phase == WHOLE}
    fuel_L = [burnt.get(number) for number in ledger_rows["cycle"]]
    u_1 = state.energy.fuel_u_1
    fuel_u_L = [None if burnt_L is None or u_1 is None else u_1 * burnt_L for burnt_L in fuel_L]
    columns += [pl.Series(FUEL, fuel_L, pl.Float64), pl.Series(FUEL_U, fuel_u_L, pl.Float64)]
    return ledger_rows.with_columns(columns)


def read_energy_amounts(ledger_row: EnergyRow) -> dict[str, EnergyAmount]:
    """Read the energy amounts of a row, by their names in the ledger."""
    if ledger_row.phase != WHOLE:
        return {ledger_row.phase: ledger_row.work}
    return {"energy": ledger_row.work, **{part: getattr(ledger_row, part) for part in PARTS[1:]}}


def _compute_energy_per_tonne(energy: EnergyAmount, ledger_row: Mapping[str, Any]) -> EnergyAmount:
    """Compute the energy per tonne of a cycle; errors of energy and payload are independent."""
    t, u_t = ledger_row["payload_kg"] / 1e3, ledger_row["payload_u_kg"] / 1e3
    if t <= 0.0:
        return EnergyAmount(0.0, 0.0)
    per_t = energy.kWh / t
    return EnergyAmount(per_t, hypot(energy.u_kWh / t, per_t * u_t / t))


def compute_energy_per_counted_tonne(
    ledger: pl.DataFrame, shift: Mapping[str, Any], state: ReviewState
) -> EnergyAmount | None:
    """Compute the energy per counted tonne; None if no counted cycle has energy and payload.

    Args:
        ledger: ledger with energy.
        shift: frame `shift` as reviewed, for the payload's relative uncertainty.
        state: state of the review, for the energy's uncertainty.
    """
    both = ledger.filter("counted", pl.col("energy_kWh").is_not_null())
    tonnes = float(both["payload_kg"].sum()) / 1e3
    if not state.energy.rows or tonnes <= 0.0:
        return None
    whole, per_t = state.energy.rows[0].work, float(both["energy_kWh"].sum()) / tonnes
    relative = hypot(whole.u_kWh / whole.kWh, shift["payload_u_kg"] / shift["payload_kg"])
    return EnergyAmount(per_t, per_t * relative)


def format_energy_amount(amount: EnergyAmount) -> str:
    """Format an energy in kWh with its 95 % interval."""
    return format_plus_minus(amount.kWh, K * amount.u_kWh)


def list_energy_names_and_values(
    ledger: pl.DataFrame, shift: Mapping[str, Any], state: ReviewState
) -> list[tuple[str, str]]:
    """List facts on the shift's energy as (name, value); empty if unknown."""
    if not state.energy.rows:
        return []
    whole = state.energy.rows[0]
    per_t = compute_energy_per_counted_tonne(ledger, shift, state)
    each = "" if per_t is None else f", {format_energy_amount(per_t)} kWh/t"
    known = sum(row.cycle is not None and row.phase == WHOLE for row in state.energy.rows)
    some = "" if known == ledger.height else f" in {known} of {ledger.height} cycles"
    lacks = state.energy.scale_unknown
    scale = f"; scale error not included (set {lacks})" if lacks else ""
    found = [
        (
            "energy at the wheels",
            f"{format_energy_amount(whole.work)} kWh"
            f"{some}{each}{_format_work_fractions(whole)}{scale}",
        )
    ]
    if whole.fuel_L is not None:
        found.append(
            ("fuel", _format_fuel_of_shift(whole.fuel_L, ledger, shift, state.energy.fuel_u_1))
        )
    return found


def _format_work_fractions(shift_energy: EnergyRow) -> str:
    """Format the fractions of the work, or say that they are not determined."""
    work = shift_energy.work.kWh
    parts = {part: getattr(shift_energy, part) for part in PARTS[1:-1]}
    # climbing may be negative, but neither acceleration nor friction returns energy to the drive
    negative = any(
        parts[part].kWh < LIMITS.energy_min_share * work for part in ("kinetic", "friction")
    )
    if negative or any(
        K * each.u_kWh > LIMITS.energy_max_u_share * work for each in parts.values()
    ):
        return ", its shares not determined"
    # + 0.0 avoids -0 %
    shares = (f"{part} {round(each.kWh / work, 2) + 0.0:.0%}" for part, each in parts.items())
    return f": {', '.join(shares)}"


def _format_fuel_of_shift(
    fuel_L: float, ledger: pl.DataFrame, shift: Mapping[str, Any], relative_u: float | None
) -> str:
    """Format the fuel of the cycles, and per counted tonne."""
    both = ledger.filter("counted", pl.col(FUEL).is_not_null())
    tonnes = float(both["payload_kg"].sum()) / 1e3
    per_t = float(both[FUEL].sum()) / tonnes if tonnes > 0.0 else None
    if relative_u is None:
        each = "" if per_t is None else f", {per_t:.3f} L/t"
        return f"{fuel_L:,.2f} L in the cycles{each}; ± not known (set machine.fuel_gain_u)"
    each = ""
    if per_t is not None:
        u_per_t = per_t * hypot(relative_u, shift["payload_u_kg"] / shift["payload_kg"])
        each = f", {format_plus_minus(per_t, K * u_per_t)} L/t"
    return f"{format_plus_minus(fuel_L, K * relative_u * fuel_L)} L in the cycles{each}"


def make_energy_table_by_phase(state: ReviewState) -> list[tuple[str, Sequence[str]]]:
    """Make a table of the shift's energy: a row per part, a column per phase; empty if unknown."""
    rows = [row for row in state.energy.rows if row.cycle is None]
    if not rows:
        return []
    # all cells have the decimal places that the uncertainty of the whole work justifies
    digits = min(
        max(1 - floor(log10(max(K * rows[0].work.u_kWh, 1e-9))), 0), LIMITS.energy_max_digits
    )
    found: list[tuple[str, Sequence[str]]]
    found = [
        (part, [make_energy_cell(getattr(row, part), digits) for row in rows]) for part in PARTS
    ]
    if any(row.fuel_L is not None for row in rows):
        u_1 = state.energy.fuel_u_1
        head = "fuel in L" if u_1 is not None else "fuel in L, ± not known"
        found.append((head, [format_litres_cell(row.fuel_L, u_1) for row in rows]))
    return found


def format_litres_cell(fuel_L: float | None, relative_u: float | None) -> str:
    """Format the table cell of a phase's fuel, with its interval if known."""
    if fuel_L is None:
        return "–"
    return (
        f"{fuel_L:.2f}" if relative_u is None else f"{fuel_L:.2f} ± {K * relative_u * fuel_L:.2f}"
    )


def make_energy_cell(amount: EnergyAmount, digits: int) -> str:
    """Format the table cell of an energy; a dash if it rounds to zero."""
    least = 0.5 * 10.0**-digits
    if abs(amount.kWh) < least and K * amount.u_kWh < least:
        return "–"
    return f"{amount.kWh:.{digits}f} ± {K * amount.u_kWh:.{digits}f}"


def convert_shift_energy_to_dict(
    ledger: pl.DataFrame, shift: Mapping[str, Any], state: ReviewState
) -> dict[str, Any] | None:
    """Convert the energy of each part and phase to JSON-compatible values; None if unknown."""
    if not state.energy.rows:
        return None
    per_t = compute_energy_per_counted_tonne(ledger, shift, state)
    return {
        "per_t": None if per_t is None else per_t._asdict(),
        "scale_unknown": state.energy.scale_unknown,
        "fuel_u_1": state.energy.fuel_u_1,
        "rows": [
            {"cycle": row.cycle, "phase": row.phase, "fuel_L": row.fuel_L}
            | {part: getattr(row, part)._asdict() for part in PARTS}
            for row in state.energy.rows
        ],
    }
