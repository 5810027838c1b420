"""A synthetic start before the first row, by which every compiled loop is loaded or compiled.

Loading the compiled loops takes about a second, and compiling them up to a minute; without it, the
first accepted window would be delayed by that time.
"""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import polars as pl

from analysis.model.settings import Settings
from analysis.online.on_board import finish, start, step
from analysis.online.online_limits import LIMITS
from estimators.interpreted import compile_even_short_loops


def compile_loops_by_synthetic_start(settings: Settings, noise: pl.DataFrame | None = None) -> None:
    """Run gate and methods through a synthetic start, so that all their loops are compiled.

    Args:
        settings: settings of the follower.
        noise: noise of the follower.
    """
    with compile_even_short_loops():
        state = start(settings, noise)
        for row in iter_rehearsal_rows(settings):
            state = step(state, row).state
        for _ in finish(state):
            pass


def iter_rehearsal_rows(settings: Settings) -> Iterator[Mapping[str, Any]]:
    """Rows of `excitation`: standstill for half a window, then acceleration."""
    window = settings.gate.window_samples
    speed = 0.0
    for row in range(window + LIMITS.rehearsed_rows):
        drives = row >= window // 2
        acc = LIMITS.rehearsed_acc_m_s2 * (1.0 + 0.5 * np.sin(0.1 * row)) if drives else 0.0
        speed += acc / settings.align.rate_hz
        force = (
            LIMITS.rehearsed_parameters[0] * acc
            + LIMITS.rehearsed_parameters[1] * speed
            + np.sin(row)
        )
        yield {
            "regressor_acc_x_m_s2": acc,
            "speed_x_m_s": speed,
            "direction_x_1": float(drives),
            "force_x_N": force,
            "speed_rate_x_m_s2": acc,
            "specific_force_x_m_s2": acc,
            "phase": "accelerating" if drives else "standstill",
        }
