"""The answer of a run: one object, which every command, recording and picture renders."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Final

import polars as pl

from analysis.model.axes import Z
from analysis.model.fingerprint import Fingerprint
from analysis.model.loss import Loss
from analysis.model.run_record import Run
from analysis.model.verdict import Verdict
from analysis.model.windows import samples_in_windows

#: What the joint fit is called among the methods.
JOINT: Final = "joint"
#: Columns of `masses` that say how a row came about rather than what it says.
_ABOUT: Final = ("method", "rows", "rows_z", "withheld", "withheld_z")
#: What the fit of all motion together has of the joint answer.
_OF_SPINS: Final = tuple(name for pair in Z.parameters for name in pair)


@dataclass(frozen=True, slots=True)
class AnswerRow:
    """Estimates by method for the whole log; also the joint fit if the log has one load.

    Attributes:
        quantities: by name and unit (`mass_kg`, `mass_std_kg`, …), then by method; None where it is
            withheld or nothing was accepted.
        estimates: by method, how many estimates it summarises.
        withheld: whether the verdict forbids its mass.
    """

    quantities: Mapping[str, Mapping[str, float | None]]
    estimates: Mapping[str, int]
    withheld: bool

    @property
    def methods(self) -> tuple[str, ...]:
        """The methods, in the order of the settings."""
        return tuple(self.estimates)

    def value(self, quantity: str, method: str) -> float | None:
        """A number; None where there is none."""
        return self.quantities.get(quantity, {}).get(method)

    def has_quantity(self, quantity: str) -> bool:
        """Whether any method has a number for it."""
        return any(value is not None for value in self.quantities.get(quantity, {}).values())

    @classmethod
    def of(
        cls,
        masses: pl.DataFrame,
        load: Mapping[str, Any] | None = None,
        motion: Mapping[str, Any] | None = None,
    ) -> "AnswerRow":
        """Read the frame `masses`, and the answer as the method `joint` before them.

        Args:
            masses: by method.
            load: the row of `loads` where there is one.
            motion: of `planar`, the fit of all motion together: its inertia is the answer's.
        """
        rows = {row["method"]: row for row in masses.to_dicts()}
        if load is not None:
            joint = dict.fromkeys(masses.columns) | {
                "mass_kg": load["mass_kg"],
                "mass_std_kg": load["u_kg"],
                "payload_kg": load["payload_kg"],
                "friction_x_N_s_m": load["friction_x_N_s_m"],
                "friction_x_std_N_s_m": load["friction_x_std_N_s_m"],
                "rows": load["manoeuvres"],
                "withheld": load["withheld"],
            }
            if motion is not None:
                joint |= {name: motion[name] for name in _OF_SPINS if name in joint}
            rows = {JOINT: joint, **rows}
        return cls(
            {
                name: {method: row[name] for method, row in rows.items()}
                for name in masses.columns
                if name not in _ABOUT
            },
            {method: int(row["rows"] or 0) for method, row in rows.items()},
            withheld=bool(rows) and all(row["withheld"] for row in rows.values()),
        )


@dataclass(frozen=True, slots=True)
class Answer:
    """Answer of a run with its uncertainty.

    Attributes:
        rows: of the whole log; none of a run without masses.
        loads: the answer by load: mass, payload and their uncertainties, or the reason for none.
        nuisances: what the fit allows besides mass and friction: prior and posterior.
        budget: where the uncertainty comes from, the largest first.
        planar: the arc and joint fits, as the frame has them.
        planar_budget: where the uncertainty of the joint one comes from, the largest first.
        accepted_share: share of the samples that lie in an accepted window.
        verdict: whether the log can weigh, check by check.
        losses: what was recorded and is missing.
        notes: what a reader should know, a sentence each.
        fingerprint: of inputs, settings and results.
        recording: where it was recorded, None where it was not.
        shift: what its cycles add up to; empty where there are none.
        findings: causes of an error that the log shows, the likeliest first.
    """

    rows: tuple[AnswerRow, ...]
    loads: Sequence[Mapping[str, Any]]
    nuisances: Sequence[Mapping[str, Any]]
    budget: Sequence[Mapping[str, Any]]
    planar: Sequence[Mapping[str, Any]]
    accepted_share: float
    verdict: Verdict
    losses: tuple[Loss, ...] = ()
    notes: tuple[str, ...] = ()
    fingerprint: Fingerprint | None = None
    recording: str | None = None
    planar_budget: Sequence[Mapping[str, Any]] = ()
    shift: Mapping[str, Any] = field(default_factory=dict[str, Any])
    findings: Sequence[Mapping[str, Any]] = ()

    def to_dict(self) -> dict[str, Any]:
        """The answer as plain JSON values; a log with one load has a mass of its own."""
        one = self.rows[0].quantities if len(self.rows) == 1 else {}
        several = {"no_mass_for": f"{len(self.loads)} loads"} if len(self.loads) > 1 else {}
        return {
            "loads": [dict(row) for row in self.loads],
            **{name: dict(by_method) for name, by_method in one.items()},
            **several,
            "nuisances": [dict(row) for row in self.nuisances],
            "budget": [dict(row) for row in self.budget],
            "planar": [dict(row) for row in self.planar],
            "planar_budget": [dict(row) for row in self.planar_budget],
            **({"shift": dict(self.shift)} if self.shift else {}),
            "accepted_share": self.accepted_share,
            "verdict": self.verdict.to_dict(),
            "losses": [asdict(loss) for loss in self.losses],
            "notes": list(self.notes),
            "fingerprint": self.fingerprint.model_dump(exclude={"frames"})
            if self.fingerprint
            else None,
            "recording": self.recording,
        }


def answer(run: Run, recording: str | None = None) -> Answer:
    """Read the answer off a run's frames; what a run lacks is left out."""
    frames, about = run.frames, run.provenance
    masses, judged, gated = (frames.get(name) for name in ("masses", "verdict", "gate"))
    share = 0.0
    if gated is not None and gated.height and "accepted_x" in gated.columns:
        window = about.settings.gate.window_samples
        share = float(samples_in_windows(gated["accepted_x"].to_numpy(), window).mean())
    loads = _rows_of_frame(run, "loads")
    shift = _rows_of_frame(run, "shift")
    one = loads[0] if len(loads) == 1 else None
    planar = _rows_of_frame(run, "planar")
    motion = next((row for row in planar if row["kind"] == "joint"), None)
    return Answer(
        rows=() if masses is None else (AnswerRow.of(masses, one, motion),),
        loads=loads,
        nuisances=_rows_of_frame(run, "nuisances"),
        budget=_rows_of_frame(run, "budget"),
        planar=planar,
        planar_budget=_rows_of_frame(run, "planar_budget"),
        shift=shift[0] if shift and shift[0]["cycles_counted"] else {},
        accepted_share=share,
        verdict=Verdict() if judged is None else Verdict.of(judged),
        findings=_rows_of_frame(run, "findings"),
        losses=about.losses,
        notes=about.notes,
        fingerprint=about.fingerprint,
        recording=recording,
    )


def _rows_of_frame(run: Run, frame: str) -> list[dict[str, Any]]:
    return run.frames[frame].to_dicts() if frame in run.frames else []
