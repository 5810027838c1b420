"""The answer as frames: the loads, the nuisances with prior and posterior, the budget."""

import numpy as np
import polars as pl

from analysis.check import Verdict
from analysis.machine import Machine
from analysis.schema import FRAMES, build
from analysis.weighing.budget import budget, combined, unknown_scale
from analysis.weighing.weigh import Weighing


def loads(
    weighing: Weighing | None, excitation: pl.DataFrame, machine: Machine, verdict: Verdict
) -> pl.DataFrame:
    """Make `loads`: one load, the whole log's.

    Args:
        weighing: the joint fit; None where nothing could be fitted.
        excitation: for its times.
        machine: empty mass, budget.
        verdict: what it forbids is withheld.
    """
    if weighing is None:
        return _no_load(verdict)
    fit, body = weighing.fit, machine.machine
    sources = budget(weighing, machine)
    t_ns = excitation["t_ns"].to_numpy()
    used = np.flatnonzero(fit.motion.used)
    mass_kg, u_kg = net_mass_kg(weighing, machine), combined(sources)
    told = verdict.can_weigh and bool(np.isfinite([mass_kg, u_kg]).all())
    empty_kg = body.empty_mass_kg
    withheld = [check.check for check in verdict.failed("mass")]
    numbers = {
        "mass_kg": mass_kg,
        "u_kg": u_kg,
        "u_random_kg": combined(sources, "random"),
        "u_common_kg": combined(sources, "common", "scale"),
        "payload_kg": np.nan if empty_kg is None else mass_kg - empty_kg,
        "payload_u_kg": np.nan
        if empty_kg is None
        else float(np.hypot(u_kg, body.empty_mass_u_kg or 0.0)),
        "friction_x_N_s_m": float(fit.fit.theta[1]),
        "friction_x_std_N_s_m": float(fit.fit.std[1]),
        "mass_halved_priors_kg": weighing.halved_kg - body.rotating_mass_kg,
        "mass_doubled_priors_kg": weighing.doubled_kg - body.rotating_mass_kg,
    }
    return build(
        "loads",
        {
            "load_id": pl.Series([0]),
            "start_t_ns": pl.Series([int(t_ns[used[0]])]),
            "end_t_ns": pl.Series([int(t_ns[used[-1]])]),
            "manoeuvres": pl.Series([int(fit.motion.group.max()) + 1]),
            **{name: np.array([value if told else np.nan]) for name, value in numbers.items()},
            "mean_samples": pl.Series([fit.mean_samples]),
            "braking_left_out": pl.Series([weighing.braking_left_out]),
            "scale_unknown": pl.Series([", ".join(unknown_scale(sources))]),
            "withheld": pl.Series([not told]),
            "withheld_for": pl.Series(
                ["" if told else ", ".join(withheld) or "the fit has no number"]
            ),
        },
    )


def _no_load(verdict: Verdict) -> pl.DataFrame:
    """One load of which nothing is known."""
    said = {
        "load_id": 0,
        "manoeuvres": 0,
        "braking_left_out": False,
        "scale_unknown": "",
        "withheld": not verdict.can_weigh,
        "withheld_for": "no manoeuvre of this log was informative enough",
    }
    columns = FRAMES["loads"].columns
    return build("loads", {c.name: pl.Series([said.get(c.name)], dtype=c.dtype) for c in columns})


def net_mass_kg(weighing: Weighing, machine: Machine) -> float:
    """The mass without what only turns."""
    return weighing.fit.mass_kg - machine.machine.rotating_mass_kg


def nuisances(weighing: Weighing | None) -> pl.DataFrame:
    """Make `nuisances`: a row a term, prior and posterior."""
    if weighing is None:
        return _empty("nuisances")
    fit = weighing.fit
    return build(
        "nuisances",
        {
            "term": pl.Series([term.name for term in fit.terms]),
            "unit": pl.Series([term.unit for term in fit.terms]),
            "prior_std": fit.prior_std,
            "posterior": fit.fit.theta[2:],
            "posterior_std": fit.fit.std[2:],
            "u_kg": np.abs(fit.fit.responses[2:, 0]),
            "meaning": pl.Series([term.meaning for term in fit.terms]),
        },
    )


def budget_frame(weighing: Weighing | None, machine: Machine) -> pl.DataFrame:
    """Make `budget`: a row a source."""
    if weighing is None:
        return _empty("budget")
    sources = budget(weighing, machine)
    total = combined(sources)
    u_kg = np.array([np.nan if source.u_kg is None else source.u_kg for source in sources])
    return build(
        "budget",
        {
            "cause": pl.Series([source.name for source in sources]),
            "kind": pl.Series([source.kind for source in sources]),
            "u_kg": u_kg,
            "share_1": u_kg**2 / total**2 if total else u_kg * np.nan,
            "meaning": pl.Series([source.meaning for source in sources]),
            "shrinks": pl.Series([source.shrinks for source in sources]),
        },
    )


def _empty(name: str) -> pl.DataFrame:
    """A frame without rows."""
    return pl.DataFrame(schema={column.name: column.dtype for column in FRAMES[name].columns})
