"""A synthetic start before the first row, which loads or compiles every loop.

Loading what is compiled already takes a second in all, and compiling it up to a minute: as late
as that came the first window that the gate accepts.
"""

from collections.abc import Iterator, Mapping
from typing import Any, Final

import numpy as np
import polars as pl

from analysis.model.settings import Settings
from analysis.online.on_board import finish, start, step
from estimators.interpreted import compile_at_once

#: Rows behind the first whole window: more than those after which a recursion is fed.
_ROWS_BEHIND: Final = 64
#: Of the machine that is made up: mass in kg and friction in N·s/m. Spins take the same loops.
_THETA: Final = (3000.0, 2000.0)
_ACC_M_S2: Final = 1.0


def rehearse(settings: Settings, noise: pl.DataFrame | None = None) -> None:
    """Run gate and methods through a synthetic start.

    Args:
        settings: settings of the follower.
        noise: noise of the follower.
    """
    with compile_at_once():
        state = start(settings, noise)
        for row in rehearsal_rows(settings):
            state = step(state, row).state
        for _ in finish(state):
            pass


def rehearsal_rows(settings: Settings) -> Iterator[Mapping[str, Any]]:
    """Rows of `excitation`: standstill for half a window, then acceleration."""
    window = settings.gate.window_samples
    speed = 0.0
    for row in range(window + _ROWS_BEHIND):
        drives = row >= window // 2
        acc = _ACC_M_S2 * (1.0 + 0.5 * np.sin(0.1 * row)) if drives else 0.0
        speed += acc / settings.align.rate_hz
        force = _THETA[0] * acc + _THETA[1] * speed + np.sin(row)
        yield {
            "regressor_acc_x_m_s2": acc,
            "speed_x_m_s": speed,
            "direction_x_1": float(drives),
            "force_x_N": force,
            "speed_rate_x_m_s2": acc,
            "specific_force_x_m_s2": acc,
            "phase": "accelerating" if drives else "standstill",
        }
