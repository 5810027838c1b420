"""Where braking counts as driving, a manoeuvre is as long as the log: its digs are not fitted."""

from dataclasses import dataclass
from typing import cast

import numpy as np
import polars as pl
import pytest

from analysis.model.schema import PHASE
from analysis.model.settings import Settings
from analysis.stages.gating.digging import add_column_of_digging_starts
from analysis.weighing.braking_comparison import compare_masses_with_and_without_braking
from analysis.weighing.fitted_stretches import mark_rows_from_dig_to_standstill
from analysis.weighing.joint_result import JointFit
from analysis.weighing.weigh import weigh
from estimators.arrays import Floats, Ints
from tests.analysis.weighing.weighed import TRUE_KG, weighed

BRAKING_AS_DRIVING = "settings.gate.exclude_braking=false"
#: To the pile and into it, out of it and away.
ROUND = [
    {"kind": "rest"},
    {"kind": "start", "throttle": 0.8},
    {"kind": "rest"},
    {"kind": "start", "digging_N": 3500.0, "digging_s": 2.0},
    {"kind": "rest"},
    {"kind": "start", "direction": "reverse", "throttle": 0.7},
    {"kind": "rest"},
    {"kind": "start", "direction": "reverse", "throttle": 0.9},
    {"kind": "rest"},
]


@pytest.mark.heavy
def test_digs_bend_no_mass_where_braking_counts_as_driving() -> None:
    campaign = {"runs": 4, "manoeuvres": ROUND, "brake_measured_share": 1.0}
    log = weighed({"campaign": campaign}, BRAKING_AS_DRIVING)
    frames = log.replayed.frames
    assert frames["digging"].height == 4
    grid = add_column_of_digging_starts(frames["aligned"], frames["digging"])
    found = weigh(grid, frames["excitation"], frames["gate"], frames["noise"], log.machine)
    assert found is not None
    assert not found.braking_left_out
    assert found.fit.motion.separate_drive_count == 4 * 3
    assert found.fit.u_kg < 0.005 * TRUE_KG
    assert abs(found.fit.mass_kg - TRUE_KG) < 3.0 * found.fit.u_kg


def test_a_dig_lasts_until_the_machine_stands_or_turns_back() -> None:
    settings = Settings()
    step = round(settings.align.rate_hz)
    #: Towards the pile, digging, braked by it, standing or backwards, and once more.
    phases = ("cruising", "accelerating", "braking", "standstill", "accelerating", "cruising")
    speeds = {
        "stands": (1.0, 1.0, 1.0, 0.0, -1.0, 1.0),
        "turns back": (1.0, 1.0, 1.0, -1.0, -1.0, 1.0),
    }
    margin = 2 * round(settings.phases.speed_rate_span_s * settings.align.rate_hz)
    digs = np.repeat([False, True, False, False, False, False], step)
    for how, speed in speeds.items():
        named = [p if how == "stands" else p.replace("standstill", "braking") for p in phases]
        marked = mark_rows_from_dig_to_standstill(
            pl.DataFrame({"digs": digs}),
            pl.DataFrame({"phase": pl.Series(np.repeat(named, step).tolist(), dtype=PHASE)}),
            np.repeat(speed, step).astype(np.float64),
            settings,
        )
        assert marked[step : 3 * step].all()
        assert not marked[: step - margin].any()
        assert not marked[3 * step + margin :].any()


def test_without_a_dig_nothing_is_marked() -> None:
    still = pl.DataFrame({"phase": pl.Series(["standstill"] * 9, dtype=PHASE)})
    for grid in (pl.DataFrame({"digs": [False] * 9}), pl.DataFrame({"t_ns": range(9)})):
        assert not mark_rows_from_dig_to_standstill(grid, still, np.zeros(9), Settings()).any()


@dataclass
class _States:
    manoeuvre_ids: Ints
    state_of_manoeuvre: Ints


@dataclass
class _Fit:
    """Loads of one manoeuvre each, that are as uncertain as each other."""

    masses_kg: Floats
    each_u_kg: float

    @property
    def states(self) -> _States:
        return _States(np.arange(self.masses_kg.size), np.arange(self.masses_kg.size))

    @property
    def mass_kg(self) -> float:
        return float(self.masses_kg[0])

    @property
    def u_kg(self) -> float:
        return self.each_u_kg

    def make_mass_coefficients_of_state(self, state: int) -> Floats:
        return np.eye(self.masses_kg.size)[state]

    def compute_mass_sum_u_kg(self, coefficients: Floats) -> float:
        return self.each_u_kg * float(np.linalg.norm(coefficients))


@pytest.mark.parametrize(
    ("changes_kg", "expected"),
    [
        ([0.0, 10.0, -10.0], (0.0, False)),
        ([500.0, 500.0, 500.0], (500.0, True)),
        ([100.0, 200.0, -300.0], (-300.0, True)),  # in the mean there is none
        ([100.0, 20.0, -120.0], (0.0, False)),
    ],
)
def test_braking_that_one_load_contradicts_is_left_out(
    changes_kg: list[float], expected: tuple[float, bool]
) -> None:
    driving = np.array([4000.0, 5000.0, 4000.0])
    fits = (_Fit(driving + changes_kg, 40.0), _Fit(driving, 30.0))
    change_kg, contradicts = compare_masses_with_and_without_braking(
        *(cast("JointFit", fit) for fit in fits)
    )
    assert (pytest.approx(change_kg), contradicts) == expected
