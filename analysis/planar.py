"""The centre of mass from arcs (stage 3), and every parameter that motion in the plane determines.

An arc holds v and ω constant, so the index (11) is undefined there: its gate is the phase `arc` for
a window and the predicted deviation of the centre of mass. One arc determines nothing by itself;
mass, inertia and friction come from straight motion and spins of the same log.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, Final

import numpy as np
import polars as pl

from analysis import fit_quality
from analysis.check import Verdict
from analysis.column_noise import axis_noise
from analysis.masses import pooled_over_log
from analysis.plane import Plane, plane_noise, plane_of
from analysis.regressor import X, Z
from analysis.schema import FRAMES, build
from analysis.segments import manoeuvres
from analysis.settings import Settings
from estimators import base_parameters
from estimators.base_parameters import BaseEstimate
from estimators.estimate import Bools, Ints
from estimators.planar_rows import PARAMETERS

Known = Mapping[str, tuple[float, float]]

_MOMENTS: Final = ("first_moment_x_kg_m", "first_moment_y_kg_m")
#: Columns of value and deviation of every parameter.
_COLUMNS: Final = {
    **dict((*X.parameters, *Z.parameters)),
    **{name: name.replace("_kg_m", "_std_kg_m") for name in _MOMENTS},
}
_COM: Final = ("com_x_m", "com_x_std_m", "com_y_m", "com_y_std_m")


def planar(
    excitation: pl.DataFrame,
    gated: pl.DataFrame,
    verdict: Verdict,
    settings: Settings,
    noise: pl.DataFrame | None = None,
) -> pl.DataFrame:
    """Make `planar`: a row an arc, one for all arcs together, and one for all motion together.

    Args:
        excitation: motion, forces and phases.
        gated: which windows are accepted, for what straight motion and spins tell.
        verdict: what it forbids is not used and not told.
        settings: what is refused, limits.
        noise: of the columns, where it is known.

    Returns:
        `planar`, without rows where the machine does not turn. What the motion does not determine
        is null, and `combinations` says what it determines instead.
    """
    plane = plane_of(excitation, settings, noise)
    rows = list(_arcs(plane, excitation, gated, verdict, settings, noise))
    joint = _joint(plane, verdict, settings)
    rows += [joint] if joint else []
    declared = FRAMES["planar"].columns
    table = pl.DataFrame(rows, schema={c.name: c.dtype for c in declared}, orient="row")
    return build("planar", table.to_dict())


def _arcs(
    plane: Plane,
    excitation: pl.DataFrame,
    gated: pl.DataFrame,
    verdict: Verdict,
    settings: Settings,
    noise: pl.DataFrame | None,
) -> Iterator[dict[str, Any]]:
    """Each arc that lasts a window, and all of them as one fit."""
    steady = plane.usable & (excitation["phase"] == "arc").fill_null(False).to_numpy()
    arc_id = np.where(steady, manoeuvres(excitation, settings), -1)
    ids, begins, counts = np.unique(arc_id[steady], return_index=True, return_counts=True)
    lasting = counts >= settings.gate.window_samples
    if not lasting.any():
        return
    # an arc is one stretch of the log
    rows = np.flatnonzero(steady)
    firsts, lasts = rows[begins[lasting]], rows[(begins + counts - 1)[lasting]]
    known: dict[str, tuple[float, float]] = {}
    for axis, told in ((X, verdict.can_weigh), (Z, verdict.tells_inertia)):
        if told:
            of_axis = axis_noise(axis, settings, noise)
            theta, std = pooled_over_log(axis, excitation, gated, settings, of_axis)
            names = [name for name, _ in axis.parameters if name in PARAMETERS]
            known |= {
                name: (float(value), float(deviation))
                for name, value, deviation in zip(names, theta, std, strict=False)
                if np.isfinite(deviation)
            }
    # a yaw torque counts once spins have vouched for it
    both = "friction_z_N_m_s" in known
    parts = [("arc", slice(first, last + 1)) for first, last in zip(firsts, lasts, strict=True)]
    parts += [("arcs", slice(firsts[0], lasts[-1] + 1))] if firsts.size > 1 else []
    lasting_ids = ids[lasting]
    for kind, part in parts:
        here, of = plane.cut(part), arc_id[part]
        of = np.where(np.isin(of, lasting_ids), of, -1)
        estimate = _fit(here, of, known, both=both)
        row = _row(kind, here, of >= 0, estimate, known)
        reason = "accepted"
        if not np.isfinite(row["com_x_m"]):
            reason = "ill_conditioned"
        elif not row["predicted_std_com_m"] <= settings.planar.threshold_std_com_m:
            reason = "low_information"
        yield _told(row, reason, withheld=not verdict.can_weigh)


def _joint(plane: Plane, verdict: Verdict, settings: Settings) -> dict[str, Any] | None:
    """One fit over all motion, where there is turning enough and a yaw torque; else None."""
    used = plane.usable & plane.moving
    if not plane.has_torque or (used & plane.turning).sum() < settings.gate.window_samples:
        return None
    estimate = _fit(plane, np.where(used, 0, -1), {}, both=True)
    row = _row("joint", plane, used, estimate, {})
    unexplained = estimate.residual_rms**2 / np.var(plane.f, axis=0, where=used[:, None])
    row["r_squared_x_1"], row["r_squared_z_1"] = (1.0 - unexplained).tolist()
    believed = _believable(plane, estimate, row, settings) and not verdict.is_contradicted
    reason = "accepted" if estimate.identifiability.identifiable.any() else "ill_conditioned"
    return _told(row, reason, withheld=not believed)


def _believable(
    plane: Plane, estimate: BaseEstimate, row: Mapping[str, Any], settings: Settings
) -> bool:
    """Whether the joint fit passes, on its own ungated samples, what straight motion must pass."""
    limits = settings.verdict
    explained = min(row["r_squared_x_1"], row["r_squared_z_1"])
    # of a mass and an inertia; those that the motion does not determine are not told anyway
    told = np.isfinite(estimate.theta[:2])
    theta, std = estimate.theta[:2][told], estimate.std[:2][told]
    force = plane.f[:, 0]
    driving = fit_quality.along_share(plane.motion.speed, force, plane.known & (plane.pace > 0))
    opposing = 1.0 - fit_quality.along_share(
        plane.motion.speed, force, plane.known & (plane.pace < 0)
    )
    return (
        explained >= limits.r_squared_min
        and bool((theta > 0.0).all() and (std <= limits.relative_std_max * theta).all())
        and not driving < limits.driving_share_min
        and not opposing < limits.opposing_share_min
    )


def _fit(plane: Plane, segment_id: Ints, known: Known, *, both: bool) -> BaseEstimate:
    """Fit the samples of segment_id >= 0; without `both`, the row of the force alone."""
    rows = 2 if both else 1
    return base_parameters.fit(
        replace(plane.motion, rows=rows),
        plane.f[:, :rows],
        PARAMETERS,
        segment_id,
        known,
        plane_noise(plane, segment_id >= 0)[:rows],
    )


def _row(
    kind: str, plane: Plane, used: Bools, estimate: BaseEstimate, known: Known
) -> dict[str, Any]:
    """What a fit says, by column."""
    found = estimate.identifiability
    t_ns = plane.t_ns[used]
    row: dict[str, Any] = {
        "kind": kind,
        "start_t_ns": int(t_ns[0]),
        "end_t_ns": int(t_ns[-1]),
        "samples": int(t_ns.size),
        "speed_x_m_s": float(plane.motion.speed[used].mean()),
        "yaw_rate_rad_s": float(plane.motion.yaw_rate[used].mean()),
        "condition_1": found.condition,
        "rank": found.rank,
        "identifiable": ", ".join(
            name
            for name, single in zip(found.parameters, found.identifiable, strict=True)
            if single
        ),
        "combinations": "; ".join(found.texts()),
    }
    for name, value, std in zip(PARAMETERS, estimate.theta, estimate.std, strict=True):
        if name not in known:
            row[name], row[_COLUMNS[name]] = float(value), float(std)
    for axis, moment in zip("xy", _MOMENTS, strict=True):
        row[f"com_{axis}_m"], row[f"com_{axis}_std_m"] = estimate.quotient(moment, "mass_kg")
    row["predicted_std_com_m"] = row["com_x_std_m"]
    for name, rms in zip(
        ("residual_rms_N", "residual_rms_N_m"), estimate.residual_rms, strict=False
    ):
        row[name] = float(rms)
    return row


def _told(row: dict[str, Any], reason: str, *, withheld: bool) -> dict[str, Any]:
    """The row with its outcome: no number of a fit that is refused or withheld."""
    row = {**row, "reason": reason, "withheld": withheld}
    if withheld or reason != "accepted":
        hidden = {*_COLUMNS, *_COLUMNS.values(), *_COM}
        row = {name: None if name in hidden else value for name, value in row.items()}
    return row
