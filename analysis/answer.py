"""The answer of a run in plain values, and in a sentence why there is none."""

from typing import Any

import numpy as np
import polars as pl

from analysis.phases import TURNS
from analysis.regressor import YAW_COLUMNS
from analysis.run import Run
from analysis.settings import Settings
from analysis.verdict import can_weigh, tells_inertia
from analysis.windows import samples_of


def answer(run: Run) -> dict[str, Any]:
    """What `payscope run --json` gives, without the recording's path.

    Masses, payloads, frictions and, where the channels allow it, inertias are given by method.
    `accepted_share` is the share of samples that lie in an accepted window. `planar` has the arc
    and joint fits.
    """
    by_method = {row["method"]: row for row in run.frames["masses"].to_dicts()}
    judged = run.frames["verdict"]
    taken = run.provenance.fingerprint
    window = run.provenance.settings.gate.window_samples
    used = samples_of(run.frames["gate"]["accepted_x"].to_numpy(), window)
    return {
        **{
            name: {method: row[name] for method, row in by_method.items()}
            for name in run.frames["masses"].columns
            if name not in ("method", "rows", "rows_z", "withheld", "withheld_z")
        },
        "planar": run.frames["planar"].to_dicts() if "planar" in run.frames else [],
        "accepted_share": float(used.mean()) if used.size else 0.0,
        "verdict": {
            "can_weigh": can_weigh(judged),
            "tells_inertia": tells_inertia(judged),
            "checks": judged.to_dicts(),
        },
        "losses": [loss.model_dump() for loss in run.provenance.losses],
        "notes": list(run.provenance.notes),
        "fingerprint": taken.model_dump(exclude={"frames"}) if taken else None,
    }


def obstacles(excitation: pl.DataFrame, gated: pl.DataFrame, settings: Settings) -> list[str]:
    """What stands between this log and an answer, a sentence each."""
    found = (
        why_nothing_was_accepted(excitation, gated, settings),
        why_spins_are_not_used(excitation, settings),
    )
    return [sentence for sentence in found if sentence]


def why_spins_are_not_used(excitation: pl.DataFrame, settings: Settings) -> str | None:
    """A sentence that names the channels that spins lack, where there are spins; else None."""
    spins = (excitation["phase"] == "spinning").fill_null(False).sum()
    missing = [name for name in YAW_COLUMNS if name not in excitation.columns]
    if spins < settings.gate.window_samples or not missing:
        return None
    remedies = {
        "torque_z_N_m": "channels.torque_z_N_m, or both wheel torques and machine.track_width_m",
        "yaw_acc_rad_s2": 'channels.yaw_acc_rad_s2 (derive = "d/dt yaw_rate_rad_s")',
    }
    wanted = " and ".join(remedies.get(name, f"channels.{name}") for name in missing)
    return f"the log has spins, but no inertia without {wanted}"


def why_nothing_was_accepted(
    excitation: pl.DataFrame, gated: pl.DataFrame, settings: Settings
) -> str | None:
    """A sentence that names the obstacle when the gate accepted no window, else None."""
    if gated["accepted_x"].any():
        return None
    window_s = settings.gate.window_samples / settings.align.rate_hz
    rows_s = excitation.height / settings.align.rate_hz
    mean_s = (settings.smooth.samples - 1) / settings.align.rate_hz
    if rows_s < window_s:
        return f"the log lasts {rows_s:.2f} s, a window needs {window_s:.2f} s"
    if excitation.height < settings.gate.window_samples + settings.smooth.samples - 1:
        return (
            f"the log lasts {rows_s:.2f} s, a window needs {window_s:.2f} s and the moving mean "
            f"before it {mean_s:.2f} s"
        )
    phase = excitation["phase"]
    whole = phase.is_not_null()
    stretches = [
        ("a gap", whole),
        ("a gap or a turn", whole & ~phase.is_in(TURNS)),
    ]
    if settings.gate.exclude_braking:
        stretches.append(("braking", whole & (phase != "braking")))
    for what, good in stretches:
        longest_s = _longest_run(good.fill_null(False)) / settings.align.rate_hz
        if longest_s < window_s:
            return (
                f"the longest stretch without {what} is {longest_s:.2f} s, "
                f"the window {window_s:.2f} s"
            )
    reasons = gated["reason_x"].cast(pl.String)
    counts = reasons.filter(reasons != "warming_up").value_counts(sort=True)
    return f"no window was accepted, most often for: {counts['reason_x'][0]}"


def _longest_run(good: pl.Series) -> int:
    edges = np.diff(np.concatenate([[0], good.to_numpy().astype(np.int8), [0]]))
    lengths = np.flatnonzero(edges < 0) - np.flatnonzero(edges > 0)
    return int(lengths.max()) if lengths.size else 0
