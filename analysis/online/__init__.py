"""On board: the gate and the estimators while the machine drives, and what they report.

    from payscope import load_machine, online

    board = online.Follower(load_machine("cat262c.toml"))
    board.append_samples("/imu/data", samples)
    for report in board.advance():
        print(report.to_dict())

`start`, `step` and `finish` do the same one row of `excitation` at a time, state in, state out.
`compile_loops_by_synthetic_start` loads all that they need in advance: no row then waits for it.
"""

from typing import TYPE_CHECKING

from estimators.late_names import make_lazy_import_getattr

if TYPE_CHECKING:
    from analysis.online.follower import Follower
    from analysis.online.on_board import finish, start, step
    from analysis.online.online_report import OnlineReport, Validity
    from analysis.online.rehearsal import compile_loops_by_synthetic_start

__all__ = [
    "Follower",
    "OnlineReport",
    "Validity",
    "compile_loops_by_synthetic_start",
    "finish",
    "start",
    "step",
]

__getattr__ = make_lazy_import_getattr(
    "analysis.online",
    {
        "Follower": "analysis.online.follower",
        "OnlineReport": "analysis.online.online_report",
        "Validity": "analysis.online.online_report",
        "finish": "analysis.online.on_board",
        "compile_loops_by_synthetic_start": "analysis.online.rehearsal",
        "start": "analysis.online.on_board",
        "step": "analysis.online.on_board",
    },
)
