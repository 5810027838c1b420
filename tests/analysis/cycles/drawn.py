"""Loads and manoeuvres of a shift that is drawn rather than driven: cycles of 100 s."""

import numpy as np
import polars as pl

from analysis.model.schema import build_frame

NS = 10**9
PERIOD_S = 100.0


def drawn_shift(
    payloads_kg: list[float],
    *,
    carried_kg: list[float] | None = None,
    noise_kg: float = 0.0,
    seed: int = 1,
    digs: bool = True,
    unseen: tuple[int, ...] = (),
    unseen_empty: tuple[int, ...] = (),
    unseen_digs: tuple[int, ...] = (),
    boom: bool = False,
    pace: float = 1.0,
    idle_s: float = 0.0,
    gained: tuple[int, float] = (0, 0.0),
) -> dict[str, pl.DataFrame]:
    """Frames of a shift: two empty starts, digging, two loaded starts, a dump, again and again.

    Args:
        payloads_kg: dumped in each cycle.
        carried_kg: what stays after each dump.
        noise_kg: of a manoeuvre.
        seed: of that.
        digs: whether digging is seen.
        unseen: cycles of whose load no start tells a mass.
        unseen_empty: cycles before whose load none does.
        unseen_digs: cycles whose digging is not seen.
        boom: whether there is one, which is out from 81 to 86 s of each cycle.
        pace: how much faster everything is.
        idle_s: stand after the last cycle.
        gained: cycle from which on the machine is heavier, without a load, and by how many kg.
    """
    random = np.random.default_rng(seed)
    carried = carried_kg or [0.0] * len(payloads_kg)
    rows: list[tuple[float, float]] = []
    dug: list[tuple[float, float]] = []
    before = 0.0
    for number, (payload, after) in enumerate(zip(payloads_kg, carried, strict=True)):
        begin = number * PERIOD_S
        empty_kg = 3600.0 + (gained[1] if number >= gained[0] else 0.0)
        if number not in unseen_empty:
            rows += [(begin + 5.0, empty_kg + before), (begin + 20.0, empty_kg + before)]
        dug.append((begin + 40.0, begin + 44.0))
        if number not in unseen:
            rows += [
                (begin + 50.0, empty_kg + payload + after),
                (begin + 65.0, empty_kg + payload + after),
            ]
        before = after
    empty_kg = 3600.0 + (gained[1] if len(payloads_kg) >= gained[0] else 0.0)
    rows.append((len(payloads_kg) * PERIOD_S + 5.0, empty_kg + before))
    start = np.array([s for s, _ in rows]) / pace
    mass = np.array([m for _, m in rows])
    state = np.cumsum(np.append(0, np.abs(np.diff(mass)) > 50.0))
    manoeuvres = build_frame(
        "manoeuvres",
        {
            "load_id": state,
            "start_t_ns": (start * NS).astype(np.int64),
            "end_t_ns": ((start + 10.0 / pace) * NS).astype(np.int64),
            "mass_kg": mass + random.normal(0.0, noise_kg, mass.size),
            "mass_std_kg": np.full(mass.size, max(noise_kg, 1.0)),
        },
    )
    loads = pl.DataFrame(
        {"load_id": np.unique(state), "scatter_kg": 0.0, "withheld": False, "withheld_for": ""}
    )
    works_s = len(payloads_kg) * PERIOD_S / pace + 15.0
    t_ns = np.arange(0, int((works_s + idle_s) * NS), NS // 10)
    seconds = t_ns / NS * pace % PERIOD_S
    still = ((seconds > 77.0) & (seconds < 90.0)) | (t_ns > works_s * NS)
    out = (seconds > 81.0) & (seconds < 86.0) & (t_ns < works_s * NS)
    spans = [span for k, span in enumerate(dug) if digs and k not in unseen_digs]
    angles = {"boom_rad": np.where(out, 0.9, 0.2)} if boom else {}
    return {
        "manoeuvres": manoeuvres,
        "loads": loads,
        "digging": build_frame(
            "digging",
            {
                "start_t_ns": pl.Series([int(a / pace * NS) for a, _ in spans], dtype=pl.Int64),
                "end_t_ns": pl.Series([int(b / pace * NS) for _, b in spans], dtype=pl.Int64),
            },
        ),
        "excitation": pl.DataFrame(
            {"t_ns": t_ns, "phase": np.where(still, "standstill", "cruising")}
        ),
        "aligned": pl.DataFrame({"t_ns": t_ns, "gap": np.zeros(t_ns.size, np.bool_), **angles}),
    }
