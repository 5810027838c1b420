"""A design of excitation for a terminal."""

from rich.console import Group, RenderableType

from analysis.excitation import Design
from replay.commands.printing import plain_table

_TITLES = {"mass_kg": "mass kg", "inertia_z_kg_m2": "Izz kg·m²", "com_x_m": "com x m"}
_DIGITS = {"mass_kg": 1, "inertia_z_kg_m2": 1, "com_x_m": 4}


def render(design: Design) -> RenderableType:
    """Lay the design out for a terminal."""
    names = list(design.scores[0].predictions)
    titles = [text for name in names for text in (f"± {_TITLES[name]}", "bias")]
    table = plain_table(
        "waveform", *titles, "error", "rank", "condition", "SNR", "needs", "peak m/s", "reach m", ""
    )
    for score in design.scores:
        numbers = [
            f"{value:.{_DIGITS[name]}f}"
            for name, each in score.predictions.items()
            for value in (each.std, each.bias)
        ]
        table.add_row(
            f"{score.waveform}, {score.ways}",
            *numbers,
            f"{score.relative_error:.2%}",
            str(score.rank),
            f"{score.condition:,.0f}",
            f"{score.snr:.1f}",
            "–" if score.snr_needed is None else f"{score.snr_needed:.1f}",
            f"{score.peak_speed_m_s:.2f}",
            f"{score.reach_m:.1f}",
            "best" if score is design.best else "",
        )
    return Group(*_timing(design), "", table, "", _verdict(design))


def _timing(design: Design) -> list[str]:
    periods = {
        "force": design.scores[0].manoeuvre.force,
        "torque": design.scores[0].manoeuvre.torque,
    }
    lines = [
        f"{axis}: response time T = {seconds:.2f} s, period {wave.period_s:.2f} s"
        for axis, seconds in design.response_s.items()
        if (wave := periods[axis]) is not None
    ]
    return [*lines, f"window {design.window_s:.2f} s"]


def _verdict(design: Design) -> str:
    best, wanted = design.best, f"{design.accuracy:.3g}"
    if best is None:
        return "No waveform fits the yard."
    name, error = f"{best.waveform}, {best.ways}", f"{best.relative_error:.2g}"
    if design.reached:
        return f"The accuracy of {wanted} is reached: {name}, has {error}."
    return f"No waveform reaches the accuracy of {wanted}: the best, {name}, has {error}."
