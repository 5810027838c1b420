"""Why a log has no answer, in a sentence each."""

import polars as pl

from analysis.model.axes import YAW_COLUMNS
from analysis.model.settings import Settings
from analysis.model.windows import runs_of
from analysis.stages.motion.phases import TURNS


def reasons_for_no_answer(
    excitation: pl.DataFrame, gated: pl.DataFrame, settings: Settings
) -> list[str]:
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
                f"the window {window_s:.2f} s{_braking_remedy(what)}"
            )
    reasons = gated["reason_x"].cast(pl.String)
    counts = reasons.filter(reasons != "warming_up").value_counts(sort=True)
    often = counts["reason_x"][0]
    return f"no window was accepted, most often for: {often}{_braking_remedy(often)}"


def _braking_remedy(what: str) -> str:
    if what != "braking":
        return ""
    return "; where the force sees the brakes, settings.gate.exclude_braking = false"


def _longest_run(good: pl.Series) -> int:
    first, last = runs_of(good.to_numpy())
    lengths = last + 1 - first
    return int(lengths.max()) if lengths.size else 0
