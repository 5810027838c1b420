"""Shifts at manoeuvre level: what each start says is drawn, and goes through states and cycles.

Constants and nuisances are as their priors have them: the force's gain, a constant force, Coulomb
friction and a friction that goes with the speed. Each manoeuvre has its own noise and scatter.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple, cast

import numpy as np
import polars as pl
from numpy.typing import NDArray

from analysis.cycles.cycles import weigh_cycles
from analysis.cycles.load_passes import LoadPasses, find_load_passes
from analysis.cycles.shift_totals import make_shift_totals_frame
from analysis.model.schema import build_frame
from analysis.model.verdict import Verdict
from analysis.weighing.fit_columns import PreviousEstimates
from analysis.weighing.growing_load import LoadGrowthAtEveryStart
from analysis.weighing.joint_result import JointFit, PriorMeans
from analysis.weighing.load_states import (
    LoadStates,
    find_load_states,
)
from analysis.weighing.nuisances import NUISANCES
from analysis.weighing.weigh import ForceCurvature, Weighing
from estimators.arrays import Floats, Ints
from estimators.joint.posterior_fit import PosteriorFit
from estimators.joint.unit_levels import UnitLevels
from replay import load_machine

EMPTY_KG: Final = 3614.0
GAIN_U: Final = 0.01
#: Widths of the priors of const, direction and slip: in N, N and as a share of the mass.
CONST_N: Final = 300.0
DIRECTION_N: Final = 300.0
FRICTION_1: Final = 0.02
_NS: Final = 10**9
_START_S: Final = 14.0
_STAND_S: Final = 6.0
_TERMS: Final = tuple(t for t in NUISANCES if t.name in ("const", "slip", "direction"))
_MACHINE: Final = load_machine(Path("cat262c.toml"))


@dataclass(frozen=True)
class DrawnShift:
    """Manoeuvres of a shift, and what is true of them.

    Attributes:
        units: what they say.
        membership: (manoeuvres,) true pass of each.
        loaded: (passes,).
        pass_kg: (passes,) true mass.
        payload_kg: (cycles,) dumped.
        noise_kg: (manoeuvres,) error that is each one's own.
        shared_kg: (manoeuvres,) error by gain and nuisances.
        start_s: (manoeuvres,).
        dug_s: starts that dig, seen.
        dump_s: (cycles,) true.
        end_s: of the shift.
    """

    units: UnitLevels
    membership: Ints
    loaded: NDArray[np.bool_]
    pass_kg: Floats
    payload_kg: Floats
    noise_kg: Floats
    shared_kg: Floats
    start_s: Floats
    dug_s: Floats
    dump_s: Floats
    end_s: float


@dataclass(frozen=True)
class ManoeuvreShift:
    """What was found, over what is stated.

    Attributes:
        cycles: true, found, and found at a true dump.
        whole: errors of payloads over their standard uncertainty.
        random: the random part likewise.
        common: the common part likewise.
        total: of the sum: whole, random and common.
        u_kg: of the sum.
        payload_u_kg: median of the payloads.
    """

    cycles: tuple[int, int, int]
    whole: Floats
    random: Floats
    common: Floats
    total: tuple[float, float, float]
    u_kg: float
    payload_u_kg: float


def drawn(dice: np.random.Generator) -> DrawnShift:
    """Draw a shift of 20 to 80 cycles."""
    count = int(dice.integers(20, 81))
    load_kg = dice.normal(dice.uniform(400.0, 900.0), dice.uniform(60.0, 180.0), count)
    load_kg = load_kg.clip(200.0, 1100.0)
    left_kg = dice.exponential(dice.uniform(1.0, 30.0), count).clip(0.0, 100.0)
    empty_kg = EMPTY_KG * dice.uniform(0.8, 1.4) - np.arange(count) * dice.uniform(0.0, 0.4)
    before_kg = np.append(0.0, left_kg[:-1])
    noise_kg = float(dice.uniform(8.0, 30.0))
    scatter_kg = float(dice.uniform(0.0, 25.0))
    starts = [dice.integers(1, 1 + most, count) for most in dice.integers(1, 5, 2)]
    of: list[int] = []
    start_s: list[float] = []
    dug_s: list[float] = []
    dump_s: list[float] = []
    now = 0.0
    for number in range(count):
        for kind in range(2):
            for _ in range(int(starts[kind][number])):
                if dice.random() < 0.95:
                    of.append(2 * number + kind)
                    start_s.append(now)
                now += _START_S + _STAND_S
            if not kind:
                if dice.random() < 0.98:
                    dug_s.append(now)
                now += _START_S
        now += 2.0
        dump_s.append(now + 4.0)
        now += 8.0
    of.append(2 * count)
    start_s.append(now)
    pass_kg = np.append(
        np.column_stack([empty_kg + before_kg, empty_kg + load_kg]).ravel(),
        empty_kg[-1] + left_kg[-1],
    )
    numbers = np.array(of)
    mass_kg, n = pass_kg[numbers], numbers.size
    acceleration, way = dice.uniform(1.0, 2.0, n), np.where(dice.random(n) < 0.6, 1.0, -1.0)
    x = np.column_stack([way / acceleration, 1.0 / acceleration, dice.uniform(0.5, 1.5, n)])
    widths = np.array([CONST_N, DIRECTION_N, FRICTION_1 * EMPTY_KG])
    shared_kg = mass_kg * dice.normal(0.0, GAIN_U) + x @ dice.normal(0.0, widths)
    own_kg = noise_kg * dice.uniform(0.7, 1.4, n)
    error_kg = dice.normal(0.0, own_kg) + dice.normal(0.0, scatter_kg, n)
    # the deviation that a manoeuvre states is itself estimated
    stated = own_kg * dice.normal(1.0, 0.1, n).clip(0.6, 1.4)
    units = UnitLevels(
        mass_kg + shared_kg + error_kg,
        x,
        stated**2,
        np.diag(widths**-2.0),
        np.zeros(3),
        1 + (np.diff(numbers) != 0).astype(np.int64),
    )
    payload_kg = load_kg - left_kg
    return DrawnShift(
        units, numbers, np.arange(2 * count + 1) % 2 == 1, pass_kg, payload_kg, error_kg,
        shared_kg, np.array(start_s), np.array(dug_s), np.array(dump_s), now + _START_S,
    )  # fmt: skip


def weighed_shift(truth: DrawnShift, *, oracle: bool = False) -> ManoeuvreShift:
    """Find states, passes and cycles; compare with the truth.

    Args:
        truth: the shift.
        oracle: whether the true boundaries are known.
    """
    number = np.arange(truth.membership.size)
    states = find_load_states(truth.units, number, None)
    if oracle:
        states = _with_true_states(truth, states)
    weighing, hat = _weighing(truth, states)
    known = _true_passes(truth, states, hat) if oracle else None
    frames = _frames(truth, states, hat)
    machine = _MACHINE.model_copy(
        update={"machine": _MACHINE.machine.model_copy(update={"force_gain_u": GAIN_U})}
    )
    table = weigh_cycles(weighing, frames, machine, Verdict(()), known).cycles
    summary = make_shift_totals_frame(table, frames["excitation"], frames["aligned"]).row(
        0, named=True
    )
    found = known or find_load_passes(frames["loads"], frames["manoeuvres"], frames["digging"])
    return _compared(truth, table, summary, found, hat)


def _with_true_states(truth: DrawnShift, states: LoadStates) -> LoadStates:
    of = np.unique(truth.membership, return_inverse=True)[1].astype(np.int64)
    return LoadStates(
        states.manoeuvre_ids, of, states.manoeuvre_mass_kg, states.std_kg, states.scatter_kg,
        states.degrees_of_freedom, states.birge_ratio,
    )  # fmt: skip


def _true_passes(truth: DrawnShift, states: LoadStates, hat: Floats) -> LoadPasses:
    """The passes as they were driven, with what their manoeuvres say."""
    weight = 1.0 / (states.std_kg**2 + states.scatter_kg**2)
    total = np.bincount(states.state_of_manoeuvre, weight)
    level_kg = truth.units.y - truth.units.x @ (hat @ truth.units.y)
    first = np.flatnonzero(np.append(True, np.diff(states.state_of_manoeuvre) > 0))
    last = np.append(first[1:] - 1, states.state_of_manoeuvre.size - 1)
    start = (truth.start_s * _NS).astype(np.int64)
    return LoadPasses(
        states.state_of_manoeuvre,
        weight / total[states.state_of_manoeuvre],
        truth.loaded[truth.membership[first]],
        np.bincount(states.state_of_manoeuvre, weight * level_kg) / total,
        1.0 / np.sqrt(total),
        start[first],
        start[last] + int(_START_S * _NS),
    )


class _Estimated(NamedTuple):
    fit: PosteriorFit


def _weighing(truth: DrawnShift, states: LoadStates) -> tuple[Weighing, Floats]:
    """The joint fit at manoeuvre level; and (3, manoeuvres), what nuisances are found of."""
    units, count = truth.units, states.state_count
    n, r = units.x.shape
    A = np.zeros((n, count + r))
    A[np.arange(n), states.state_of_manoeuvre] = 1.0
    A[:, count:] = units.x
    weight = 1.0 / (units.variance + states.scatter_kg**2)
    prior = np.zeros(count + r)
    prior[count:] = np.diag(units.gram)
    bread = np.linalg.inv(A.T @ (A * weight[:, None]) + np.diag(prior))
    hat = bread @ (A * weight[:, None]).T
    width = np.zeros(count + r)
    width[count:] = prior[count:] ** -0.5
    theta = hat @ units.y
    fit = PosteriorFit(
        theta=theta,
        noise=(hat * units.variance) @ hat.T,
        responses=(bread * prior * width).T,
        scatter=states.scatter_kg**2 * hat @ hat.T,
        misfit=np.zeros((count + r, count + r)),
        doubt=np.zeros(count + r),
        noise_share=0.0,
        scatter_ratio=states.birge_ratio,
        misfit_ratio=float("nan"),
        groups=n,
        residual=units.y - A @ theta,
        residual_rms=0.0,
    )
    # friction has a place in the fit that nothing here is about
    fit = _with_friction(fit, count)
    joint = JointFit(
        _TERMS, width[count:], fit.theta, _Estimated(fit), states,
        None, 10, cast(Any, None), np.zeros(count),
        PreviousEstimates(), True, PriorMeans(np.zeros(r), np.zeros(r)),
    )  # fmt: skip
    masses = theta[:count]
    weighing = Weighing(
        joint, masses, masses, float("nan"), False, False, ForceCurvature(0.0, 0.0, 1.0),
        LoadGrowthAtEveryStart(0.0, 0.0), (),
    )  # fmt: skip
    return weighing, hat[count:]


def _with_friction(fit: PosteriorFit, place: int) -> PosteriorFit:
    def wide(x: Floats) -> Floats:
        for axis in range(x.ndim):
            x = np.insert(x, place, 0.0, axis=axis)
        return x

    return PosteriorFit(
        wide(fit.theta), wide(fit.noise), wide(fit.responses), wide(fit.scatter),
        wide(fit.misfit), wide(fit.doubt), fit.noise_share, fit.scatter_ratio, fit.misfit_ratio,
        fit.groups, fit.residual, fit.residual_rms,
    )  # fmt: skip


def _frames(truth: DrawnShift, states: LoadStates, hat: Floats) -> dict[str, pl.DataFrame]:
    level_kg = truth.units.y - truth.units.x @ (hat @ truth.units.y)
    start = (truth.start_s * _NS).astype(np.int64)
    dug = (truth.dug_s * _NS).astype(np.int64)
    t_ns = np.arange(0, int(truth.end_s * _NS), _NS // 2)
    still = np.zeros(t_ns.size, np.bool_)
    for at in truth.dump_s:
        still[np.searchsorted(t_ns, (at - 4.0) * _NS) : np.searchsorted(t_ns, (at + 4.0) * _NS)] = 1
    return {
        "manoeuvres": build_frame(
            "manoeuvres",
            {
                "load_id": states.state_of_manoeuvre,
                "start_t_ns": start,
                "end_t_ns": start + int(_START_S * _NS),
                "mass_kg": level_kg,
                "mass_std_kg": states.std_kg,
            },
        ),
        "loads": pl.DataFrame(
            {
                "load_id": np.arange(states.state_count),
                "scatter_kg": states.scatter_kg,
                "withheld": False,
                "withheld_for": "",
            }
        ),
        "digging": build_frame("digging", {"start_t_ns": dug, "end_t_ns": dug + 4 * _NS}),
        "excitation": pl.DataFrame(
            {"t_ns": t_ns, "phase": np.where(still, "standstill", "cruising")}
        ),
        "aligned": pl.DataFrame({"t_ns": t_ns, "gap": np.zeros(t_ns.size, np.bool_)}),
    }


def _compared(
    truth: DrawnShift,
    table: pl.DataFrame,
    summary: dict[str, Any],
    known: LoadPasses | None,
    hat: Floats,
) -> ManoeuvreShift:
    """Match cycles by their dumps; part each error in what is random and what is common."""
    found = table.filter(pl.col("dump_t_ns").is_not_null()).to_dicts()
    at = np.array([row["dump_t_ns"] for row in found]) / _NS
    pairs = [
        (here, int(np.argmin(np.abs(truth.dump_s - t))))
        for here, t in enumerate(at)
        if np.abs(truth.dump_s - t).min() < 5.0
    ]
    # what the nuisances are found wrong by is shared, and so is the gain
    errors_kg = truth.shared_kg - truth.units.x @ (hat @ (truth.noise_kg + truth.shared_kg))
    of_pass = (
        np.zeros(0)
        if known is None
        else np.bincount(known.pass_of_manoeuvre, known.share * errors_kg)
    )
    whole: list[float] = []
    parts: list[tuple[float, float]] = []
    common_kg = 0.0
    for here, there in pairs:
        row = found[here]
        if row["payload_kg"] is None:
            continue
        error = row["payload_kg"] - truth.payload_kg[there]
        common = _of_row(row, of_pass)
        common_kg += common
        whole.append(error / row["payload_u_kg"])
        parts.append(
            (
                (error - common) / row["payload_u_random_kg"],
                common / max(row["payload_u_common_kg"], 1e-9),
            )
        )
    counted = [t for h, t in pairs if found[h]["counted"]]
    total = summary["payload_kg"] - float(truth.payload_kg[counted].sum())
    random, common = np.array(parts).reshape(-1, 2).T
    return ManoeuvreShift(
        (truth.payload_kg.size, len(found), len(pairs)),
        np.array(whole),
        random,
        common,
        (
            total / max(summary["payload_u_kg"], 1e-9),
            (total - common_kg) / max(summary["payload_u_random_kg"], 1e-9),
            common_kg / max(summary["payload_u_common_kg"], 1e-9),
        ),
        summary["payload_u_kg"],
        float(np.median(table["payload_u_kg"].drop_nulls())) if whole else float("nan"),
    )


def _of_row(row: dict[str, Any], of_pass: Floats) -> float:
    """An error of the passes in a cycle's payload."""
    before_1 = row["tare_before_1"]
    shares = (("loaded", 1.0), ("empty_before", -before_1), ("empty_after", before_1 - 1.0))
    told = [(share, row[f"{name}_id"]) for name, share in shares]
    return float(sum(share * of_pass[number] for share, number in told if number is not None))
