"""Decision whether later masses are within the error limits of a class, with a guard band."""

from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np
from pydantic import ConfigDict
from pydantic.dataclasses import dataclass

from analysis.calibration.line.calibration import Calibration
from estimators.errors import DataError, suggest_choice

_CONFIG: Final = ConfigDict(extra="forbid", allow_inf_nan=False)
#: OIML R 51: ends of the ranges of load in scale intervals e, by class; the last is the maximum.
_R51_STEPS_E: Final[Mapping[str, tuple[float, float, float]]] = {
    "OIML R 51 Y(a)": (500.0, 2000.0, 10_000.0),
    "OIML R 51 Y(b)": (50.0, 200.0, 1000.0),
}
#: OIML R 51: error limits in e in these ranges, at initial verification and in service.
_R51_LIMITS_E: Final = {False: (1.5, 2.0, 2.5), True: (2.0, 3.0, 4.0)}
#: OIML R 134: error limits as fractions of the mass at initial verification; twice that in service.
#: Larger limits by scale interval and axles are not used.
_R134_LIMITS_1: Final[Mapping[str, float]] = {
    "OIML R 134 0.2": 0.0010,
    "OIML R 134 0.5": 0.0025,
    "OIML R 134 1": 0.0050,
    "OIML R 134 2": 0.0100,
    "OIML R 134 5": 0.0250,
    "OIML R 134 10": 0.0500,
}
CLASSES: Final = (*_R51_STEPS_E, *_R134_LIMITS_1)
WITHIN, UNDECIDED, OUTSIDE = "within", "undecided", "outside"


@dataclass(frozen=True, slots=True, config=_CONFIG)
class DecisionRule:
    """Question to decide, and the probability that the answer must reach.

    Attributes:
        accuracy_class: one of `CLASSES`.
        scale_interval_kg: e of R 51; None for R 134.
        in_service: whether the wider limits of a machine in service hold.
        tare_kg: taken off the references before the limits are looked up: the machine's own mass
            where a load is judged.
        risk_1: a later mass is said to be within (or outside of) the limits where the opposite has
            at most this probability; between the two it is undecided. The guard band follows.
    """

    accuracy_class: str
    scale_interval_kg: float | None = None
    in_service: bool = False
    tare_kg: float = 0.0
    risk_1: float = 0.05


@dataclass(frozen=True, slots=True, config=_CONFIG)
class LimitRow:
    """One load of the campaign.

    Attributes:
        load_id: id of the load.
        load_kg: its reference, less the tare.
        limit_kg: error limit of the accuracy class, ± in kg.
        error_kg: error of its runs with the line fitted to the other loads, or to all loads where
            those determine no line.
        u_kg: standard uncertainty of a later mass there.
        guard_kg: guard band: an error up to limit less guard is accepted.
        verdict: "within", "outside" or "undecided".
        outside_1: probability that a later mass of this load errs by more than the limit.
    """

    load_id: str
    load_kg: float
    limit_kg: float
    error_kg: float
    u_kg: float
    guard_kg: float
    verdict: str
    outside_1: float


@dataclass(frozen=True, slots=True, config=_CONFIG)
class ErrorLimits:
    """The verdict of all loads, its risk, and a sentence that claims no more."""

    rule: DecisionRule
    rows: tuple[LimitRow, ...]
    verdict: str
    risk_1: float
    statement: str


def compute_error_limit_of_load_kg(rule: DecisionRule, load_kg: float) -> float:
    """Error limit of a class for a load, to either side, in kg.

    Raises:
        DataError: an unknown class, one that needs a scale interval without any, or a load of more
            scale intervals than the class has.

    Source:
        OIML R 51-1 (2006), category Y in automatic operation (its table is also in the Northern
        Ireland Statutory Rule 2006 No. 154, schedule 5); OIML R 134-1 (2006), 2.2, vehicle mass.
    """
    name = rule.accuracy_class
    if name in _R134_LIMITS_1:
        return _R134_LIMITS_1[name] * (2.0 if rule.in_service else 1.0) * abs(load_kg)
    if name not in _R51_STEPS_E:
        raise DataError(f"error limits: no class '{name}'; {suggest_choice(name, CLASSES)}")
    e_kg = rule.scale_interval_kg
    if e_kg is None or not e_kg > 0.0:
        raise DataError(f"error limits: {name} needs a scale interval e; set scale_interval_kg")
    load_e = abs(load_kg) / e_kg
    step = int(np.searchsorted(_R51_STEPS_E[name], load_e))
    if step == len(_R51_STEPS_E[name]):
        raise DataError(
            f"error limits: {name} ends at {_R51_STEPS_E[name][-1]:g} e, and a load of "
            f"{abs(load_kg):g} kg is {load_e:.0f} e; set a larger scale_interval_kg (e)"
        )
    return _R51_LIMITS_E[rule.in_service][step] * e_kg


def judge_loads_by_error_limits(calibration: Calibration, rule: DecisionRule) -> ErrorLimits:
    """Judge later masses at each load of the campaign.

    A later mass is assumed to err by the mean leave-one-out error of its load, and by the
    uncertainty of a calibrated mass. It is within the limits if the probability of a larger error
    is at most the rule's risk.

    Args:
        calibration: calibration of the campaign.
        rule: decision rule.

    Raises:
        DataError: an unknown class, or one that needs a scale interval without any.

    Source:
        JCGM 106:2012, 8.3 (guarded acceptance, specific risk).
    """
    readings = float(calibration.budget_at[1])
    inversion = calibration.inversion
    rows: list[LimitRow] = []
    for load_id, reference_kg, error_kg in list_mean_errors_of_loads(calibration):
        limit = compute_error_limit_of_load_kg(rule, reference_kg - rule.tare_kg)
        outside = min(
            inversion.compute_exceedance_probability(limit - error_kg, reference_kg, readings)
            + inversion.compute_exceedance_probability(limit + error_kg, reference_kg, readings),
            1.0,
        )
        one_sided = 1.0 - 2.0 * rule.risk_1
        rows.append(
            LimitRow(
                load_id=load_id,
                load_kg=reference_kg - rule.tare_kg,
                limit_kg=limit,
                error_kg=error_kg,
                u_kg=inversion.compute_later_mass_u_kg(reference_kg, readings),
                guard_kg=inversion.compute_half_interval_kg(reference_kg, one_sided, readings),
                verdict=choose_verdict_by_exceedance_risk(outside, rule.risk_1),
                outside_1=outside,
            )
        )
    return choose_worst_verdict(rule, tuple(rows))


class LoadError(NamedTuple):
    """Mean error of a load on board, in kg."""

    load_id: str
    reference_kg: float
    mean_error_kg: float


def list_mean_errors_of_loads(calibration: Calibration) -> list[LoadError]:
    """Mean error of each load on board."""
    found: list[LoadError] = []
    for reference in calibration.references:
        errors = [
            point.error_kg if point.error_left_out_kg is None else point.error_left_out_kg
            for point in calibration.points
            if point.load_id == reference.load_id
        ]
        known = [error for error in errors if error is not None]
        if known:
            found.append(
                LoadError(reference.load_id, reference.reference_kg, float(np.mean(known)))
            )
    return found


def choose_verdict_by_exceedance_risk(
    exceedance_probability_1: float, allowed_risk_1: float
) -> str:
    """Verdict on one load by the probability that a mass is beyond the limits."""
    if exceedance_probability_1 <= allowed_risk_1:
        return WITHIN
    return OUTSIDE if exceedance_probability_1 >= 1.0 - allowed_risk_1 else UNDECIDED


def choose_worst_verdict(rule: DecisionRule, limit_rows: tuple[LimitRow, ...]) -> ErrorLimits:
    """The worst verdict of all loads, its risk and its sentence."""
    verdicts = {row.verdict for row in limit_rows}
    verdict = next(v for v in (OUTSIDE, UNDECIDED, WITHIN) if v in verdicts)
    when = "in service" if rule.in_service else "at first verification"
    of_class = f"the error limits of {rule.accuracy_class} {when}"
    worst = max(row.outside_1 for row in limit_rows)
    if verdict == WITHIN:
        risk = worst
        text = (
            f"within {of_class} at every load; a mass is beyond them with a probability of at most "
            f"{risk:.2g}"
        )
    elif verdict == OUTSIDE:
        out = [row for row in limit_rows if row.verdict == OUTSIDE]
        risk = 1.0 - max(row.outside_1 for row in out)
        loads = ", ".join(f"{row.load_kg:g}" for row in out)
        text = (
            f"outside of {of_class} at {loads} kg; a mass there is within them with a probability "
            f"of {risk:.2g}"
        )
    else:
        risk = min(worst, 1.0 - worst)
        text = (
            f"neither within nor outside of {of_class} at a risk of {rule.risk_1:g}: a mass is "
            f"beyond them with a probability of up to {worst:.2g}"
        )
    return ErrorLimits(rule, limit_rows, verdict, risk, text)
