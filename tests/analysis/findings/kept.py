"""Kept findings: each fault in two small logs, and what is named of it.

    python -m tests.analysis.findings.kept    keep the findings as they are now (make findings-kept)

`kept.json` has a line a log: its findings in their order, each with the causes that this log cannot
tell from it, and the kilograms by which mending it would change the mass, with their ±. They are
what findings say now, right or wrong; how often they are right, `make findings` measures.
"""

import json
import sys
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Final

from benchmarks.findings_rows import design, needed, replayed
from tests.trials.drawn_designs import join_designs
from tests.trials.fault_injection import FAULTS, Fault

PATH: Final = Path(__file__).with_suffix(".json")
UPDATE: Final = "make findings-kept"
#: Size of the faults by the seed of a machine whose logs are short: just seen, where it drives both
#: ways, and plain, where it drives forward.
SIZES: Final[Mapping[int, float]] = {11: 1.0, 9: 3.0}
#: The machine on which every fault is plain.
PLAIN: Final = 9
#: Kilograms are alike within so much of their ±: another processor changes less,
ALIKE_1: Final = 0.1
#: unless they are no better known than this, of machines of 3 to 4 t: then a last bit decides which
#: loads a refit finds (clipped starts: -1080 ± 643 on one processor, +234 ± 367 kg on another).
TOLD_U_KG: Final = 300.0
OR: Final = " or "
#: Causes of a finding, its kilograms and their ±.
Kept = tuple[str, float | None, float | None]


def findings(seed: int, faults: Iterable[Fault] = FAULTS) -> dict[str, list[Kept]]:
    """What is found of each fault, by log."""
    return {log_name(seed, fault): _found(seed, fault, _size(seed, fault)) for fault in faults}


def log_name(seed: int, fault: Fault) -> str:
    """What a log with a fault is kept under."""
    return f"machine {seed}, {fault.name}, size {_size(seed, fault):g}"


def _size(seed: int, fault: Fault) -> float:
    return min(SIZES[seed], fault.largest or SIZES[seed])


def _found(seed: int, fault: Fault, size: float) -> list[Kept]:
    sections = needed(design(seed, odd=False), [fault])
    if fault.ground is not None:
        sections = join_designs(sections, fault.ground(sections, size))
    rows = replayed(sections, [(fault, size)]).frames["findings"].to_dicts()
    return [
        (
            OR.join([row["cause"], *filter(None, row["alternatives"].split(", "))]),
            _digits(row["mass_change_kg"]),
            _digits(row["mass_change_u_kg"]),
        )
        for row in rows
    ]


def _digits(value: float | None) -> float | None:
    return None if value is None else float(f"{value:.6g}")


def read_kept(seed: int) -> dict[str, list[Kept]]:
    """The kept findings of a seed's machine."""
    every = json.loads(PATH.read_text(encoding="utf-8"))
    mine = {log: rows for log, rows in every.items() if log.startswith(f"machine {seed}, ")}
    return {log: [(row[0], row[1], row[2]) for row in rows] for log, rows in mine.items()}


def differences(kept: Mapping[str, list[Kept]], now: Mapping[str, list[Kept]]) -> Iterator[str]:
    """Yield each log whose findings are others, as lines of a diff."""
    for log in dict.fromkeys((*kept, *now)):
        before, after = kept.get(log), now.get(log)
        if before is None or after is None or not _alike(before, after):
            yield log
            if before is not None:
                yield f"  - {_said(before)}"
            if after is not None:
                yield f"  + {_said(after)}"


def _alike(before: list[Kept], after: list[Kept]) -> bool:
    if len(before) != len(after):
        return False
    pairs = list(zip(before, after, strict=True))
    return all(_alike_causes(one[0], other[0]) for one, other in pairs) and all(
        _alike_kg(one, other) for one, other in pairs
    )


def _alike_causes(before: str, after: str) -> bool:
    """Each names the other's first cause: who else is of a class, a last bit may decide."""
    one, other = before.split(OR), after.split(OR)
    return one[0] in other and other[0] in one


def _alike_kg(before: Kept, after: Kept) -> bool:
    (_, kg, u_kg), (_, now_kg, u_now_kg) = before, after
    if kg is None or u_kg is None or now_kg is None or u_now_kg is None:
        return kg is now_kg is None
    if min(u_kg, u_now_kg) > TOLD_U_KG:
        return True
    return max(abs(now_kg - kg), abs(u_now_kg - u_kg)) <= ALIKE_1 * u_kg


def _said(rows: list[Kept]) -> str:
    return "; ".join(_row(*row) for row in rows) or "nothing"


def _row(causes: str, kg: float | None, u_kg: float | None) -> str:
    return causes if kg is None or u_kg is None else f"{causes} {kg:+.0f} ± {u_kg:.0f} kg"


def main() -> None:
    """Keep the findings as they are now, and print what that changes."""
    every: dict[str, list[Kept]] = {}
    for seed in SIZES:
        now = findings(seed)
        for line in differences(read_kept(seed) if PATH.exists() else {}, now):
            sys.stdout.write(f"{line}\n")
        every |= now
    lines = (f"  {json.dumps(log)}: {json.dumps(rows)}" for log, rows in every.items())
    PATH.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")


if __name__ == "__main__":
    main()
