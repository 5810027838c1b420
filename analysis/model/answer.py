"""The answer of a run: one object that every command, recording and picture renders."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Final

import polars as pl

from analysis.model.axes import Z
from analysis.model.fingerprint import Fingerprint
from analysis.model.loss import Loss
from analysis.model.run_record import Run
from analysis.model.verdict import Verdict
from analysis.model.windows import mark_samples_in_accepted_windows

#: Name of the joint fit among the methods.
JOINT: Final = "joint"
#: Columns of `masses` that describe a row instead of being a result.
_ABOUT: Final = ("method", "rows", "rows_z", "withheld", "withheld_z")
#: Columns of the joint answer that the planar fit of all motion gives.
_OF_SPINS: Final = tuple(name for pair in Z.parameters for name in pair)


@dataclass(frozen=True, slots=True)
class AnswerRow:
    """Estimates by method for the whole log; also the joint fit if the log has one load.

    Attributes:
        quantities: values by name and unit (`mass_kg`, `mass_std_kg`, …), then by method; None if
            withheld or not estimated.
        estimates: number of summarised estimates, by method.
        withheld: whether the verdict withholds its mass.
    """

    quantities: Mapping[str, Mapping[str, float | None]]
    estimates: Mapping[str, int]
    withheld: bool

    @property
    def methods(self) -> tuple[str, ...]:
        """The methods, in the order of the settings."""
        return tuple(self.estimates)

    def estimate(self, quantity: str, method: str) -> float | None:
        """Value of a quantity; None if there is none."""
        return self.quantities.get(quantity, {}).get(method)

    def has_quantity(self, quantity: str) -> bool:
        """Whether any method has a value of the quantity."""
        return any(value is not None for value in self.quantities.get(quantity, {}).values())

    @classmethod
    def from_masses(
        cls,
        masses: pl.DataFrame,
        load_row: Mapping[str, Any] | None = None,
        planar_row: Mapping[str, Any] | None = None,
    ) -> "AnswerRow":
        """Build the row from the frame `masses`, with the joint fit as first method.

        Args:
            masses: frame with a row per method.
            load_row: row of `loads` for a single load.
            planar_row: row of `planar` for all motion, which gives the inertia of the answer.
        """
        rows = {row["method"]: row for row in masses.to_dicts()}
        if load_row is not None:
            joint = dict.fromkeys(masses.columns) | {
                "mass_kg": load_row["mass_kg"],
                "mass_std_kg": load_row["u_kg"],
                "payload_kg": load_row["payload_kg"],
                "friction_x_N_s_m": load_row["friction_x_N_s_m"],
                "friction_x_std_N_s_m": load_row["friction_x_std_N_s_m"],
                "rows": load_row["manoeuvres"],
                "withheld": load_row["withheld"],
            }
            if planar_row is not None:
                joint |= {name: planar_row[name] for name in _OF_SPINS if name in joint}
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
        rows: rows of the whole log; empty without masses.
        loads: the answer by load: mass, payload and their uncertainties, or the reason for none.
        nuisances: prior and posterior of each nuisance.
        budget: uncertainty sources, the largest first.
        planar: planar fits of arcs and of all motion, as in the frame `planar`.
        planar_budget: uncertainty sources of the joint planar fit, the largest first.
        accepted_share: fraction of the samples in accepted windows.
        verdict: whether the log can weigh, check by check.
        losses: data that were recorded and are missing.
        notes: notes for the reader, a sentence each.
        fingerprint: digests of inputs, settings and results.
        recording: path of the recording; None without one.
        shift: totals of the cycles; empty without cycles.
        findings: causes of error found in the log, in the order of their rank.
        stated_empty_mass: empty mass in the machine file and its uncertainty, in kg; None if it is
            not stated.
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
    stated_empty_mass: tuple[float, float] | None = None

    def to_dict(self) -> dict[str, Any]:
        """The answer as JSON-compatible values; with one load, its masses are outside `loads`."""
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


def make_answer(run: Run, recording: str | None = None) -> Answer:
    """Build the answer from a run's frames; missing frames are skipped."""
    frames, about = run.frames, run.provenance
    masses, judged, gated = (frames.get(name) for name in ("masses", "verdict", "gate"))
    share = 0.0
    if gated is not None and gated.height and "accepted_x" in gated.columns:
        window = about.settings.gate.window_samples
        share = float(
            mark_samples_in_accepted_windows(gated["accepted_x"].to_numpy(), window).mean()
        )
    loads = _list_rows_of_frame_as_dicts(run, "loads")
    shift = _list_rows_of_frame_as_dicts(run, "shift")
    one = loads[0] if len(loads) == 1 else None
    planar = _list_rows_of_frame_as_dicts(run, "planar")
    motion = next((row for row in planar if row["kind"] == "joint"), None)
    body = about.machine.get("machine", {})
    empty_kg, empty_u_kg = body.get("empty_mass_kg"), body.get("empty_mass_u_kg")
    return Answer(
        rows=() if masses is None else (AnswerRow.from_masses(masses, one, motion),),
        loads=loads,
        nuisances=_list_rows_of_frame_as_dicts(run, "nuisances"),
        budget=_list_rows_of_frame_as_dicts(run, "budget"),
        planar=planar,
        planar_budget=_list_rows_of_frame_as_dicts(run, "planar_budget"),
        shift=shift[0] if shift and shift[0]["cycles_counted"] else {},
        accepted_share=share,
        verdict=Verdict() if judged is None else Verdict.from_frame(judged),
        findings=_list_rows_of_frame_as_dicts(run, "findings"),
        losses=about.losses,
        notes=about.notes,
        fingerprint=about.fingerprint,
        recording=recording,
        stated_empty_mass=None if empty_kg is None else (empty_kg, empty_u_kg or 0.0),
    )


def _list_rows_of_frame_as_dicts(run: Run, frame_name: str) -> list[dict[str, Any]]:
    return run.frames[frame_name].to_dicts() if frame_name in run.frames else []
