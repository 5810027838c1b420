"""State of a review besides its ledger: its inputs, and further content of the page."""

from pathlib import Path
from typing import Annotated, Any, Final, NamedTuple, TypeAlias

import numpy as np
import polars as pl
from pydantic import AfterValidator, BaseModel, ConfigDict, ValidationError

from analysis.cycles.cycle_energy import NO_ENERGY, ShiftEnergy
from analysis.cycles.cycle_parts import (
    CycleMotion,
    DriveSummary,
    find_idle_spans_ns,
    summarise_cycle_motion,
    summarise_shift_motion,
)
from analysis.cycles.cycles_lost_in_gaps import find_spans_of_missing_channels_ns
from analysis.cycles.friction_trend import FrictionPart, fit_viscous_friction_by_shift_part
from analysis.model.check_names import replace_former_check_names, replace_former_names_in_evidence
from analysis.model.physical_units import NS
from analysis.model.run_record import InputFile, Run
from analysis.model.verdict import Verdict
from analysis.weighing.load_frames import SINGLE_LOAD_PROBABILITY, UNWEIGHED_DRIVES
from estimators.errors import format_count
from recordings.report.clock_text import ShiftClock
from recordings.report.finding_text import format_finding, read_findings_of_run
from recordings.review.review_limits import LIMITS
from recordings.review.truncated_logs import TruncatedLog
from recordings.rrd.recording_properties import format_local_time, read_machine_section
from recordings.rrd.recording_texts import read_machine_name

STATE: Final = "review.json"
RECORDING: Final = "shift.rrd"
#: Version of the state, raised whenever existing reviews must be made again.
FORMAT: Final = 9
#: Name of a check; former names in a state of an earlier version are replaced.
_CheckNames: TypeAlias = Annotated[str, AfterValidator(replace_former_check_names)]
_Evidence: TypeAlias = Annotated[str, AfterValidator(replace_former_names_in_evidence)]


class TopicSampling(BaseModel):
    """Regularity of a topic's samples."""

    model_config = ConfigDict(frozen=True)

    topic: str
    messages: int
    rate_hz: float | None
    longest_s: float | None
    late_1: float | None


class FailedCheck(BaseModel):
    """A failed check, and its consequence."""

    model_config = ConfigDict(frozen=True)

    check: _CheckNames
    value: float | None
    limit: str
    consequence: str
    meaning: str
    remedy: str


class ReviewState(BaseModel):
    """Data of a review that its recording and ledger do not contain.

    Attributes:
        key: digest of everything that the replay depends on.
        recording_sha256: digest of `shift.rrd`, to which this state belongs.
        cycles_sha256: digest of the ledger's cycles without verdicts; empty in reviews of earlier
            versions.
        resolved: machine, settings and options by name, as JSON-compatible values.
        gate_shares: fraction of the recorded time by the gate's reason.
        friction: viscous friction of the fit in N·s/m, and its standard deviation.
        friction_parts: the same for parts of the shift.
        no_cycle: why no cycle was found; else empty.
        unweighed_drives: note on drives whose load no start determines, if they are most.
        gaps_s: gaps of the recording, since the first sample.
        timezone: time zone of the machine.
        serial: serial number of the machine; empty without one.
        duration_s: time from the first sample to the last.
        motions: motion of each cycle.
        motion: motion of the whole shift.
        energy: energy of the shift and of each cycle.
        idle_s: standstills of more than half a minute, since the first sample.
        torn: truncated logs.
        calibration: description of the calibration, and objections to it.
        mixed_machines: warning that the logs may be of two machines, or that the empty machine
            changes within them; else empty.
        findings: relevant causes of a wrong mass in these logs, a line each.
    """

    model_config = ConfigDict(frozen=True)

    format: int = FORMAT
    key: str
    recording_sha256: str
    cycles_sha256: str = ""
    inputs: tuple[InputFile, ...]
    resolved: dict[str, Any]
    t0_unix_ns: int
    machine: str
    begins: str
    can_weigh: bool
    failed: tuple[FailedCheck, ...]
    losses: tuple[str, ...]
    notes: tuple[str, ...]
    gate_shares: dict[str, float]
    gaps_s: tuple[tuple[float, float], ...]
    sampling: tuple[TopicSampling, ...]
    friction: tuple[float | None, float | None]
    friction_parts: tuple[FrictionPart, ...] = ()
    digs: int
    findings: tuple[_Evidence, ...] = ()
    no_cycle: _CheckNames = ""
    unweighed_drives: str = ""
    mixed_machines: str = ""
    timezone: str = "UTC"
    serial: str = ""
    duration_s: float = 0.0
    motions: tuple[CycleMotion, ...] = ()
    motion: DriveSummary = DriveSummary(None, None, 0.0, 0.0, 0.0)
    energy: ShiftEnergy = NO_ENERGY
    idle_s: tuple[tuple[float, float], ...] = ()
    torn: tuple[TruncatedLog, ...] = ()
    calibration: tuple[str, str] = ("", "")

    @property
    def clock(self) -> ShiftClock:
        """Local clock of the shift."""
        return ShiftClock(self.timezone, self.t0_unix_ns, self.duration_s)

    @property
    def mass_withholding_checks(self) -> tuple[FailedCheck, ...]:
        """Failed checks that withhold the masses."""
        return tuple(each for each in self.failed if each.consequence == "withhold")

    @property
    def failed_checks_that_withhold_nothing(self) -> tuple[FailedCheck, ...]:
        """Failed checks that withhold no mass."""
        return tuple(each for each in self.failed if each.consequence != "withhold")


def collect_review_state(
    run: Run,
    inputs_digest: str,
    recording_sha256: str,
    resolved_settings: dict[str, Any],
    mixed_machines_warning: str = "",
    truncated_logs: tuple[TruncatedLog, ...] = (),
    energy: ShiftEnergy = NO_ENERGY,
) -> ReviewState:
    """Collect the state of a review from a replay.

    Args:
        run: run of all logs of the shift.
        inputs_digest: digest of everything that it depends on.
        recording_sha256: digest of the recording.
        resolved_settings: see `ReviewState`.
        mixed_machines_warning: see `ReviewState`.
        truncated_logs: see `ReviewState`.
        energy: see `ReviewState`.
    """
    about, frames = run.provenance, run.frames
    verdict = Verdict.from_frame(frames["verdict"])
    gate = frames["gate"]
    shares = gate["reason_x"].cast(pl.String).value_counts(sort=True, normalize=True)
    gaps = find_spans_of_missing_channels_ns(frames["excitation"], frames["aligned"])
    load = frames["loads"].row(0, named=True)
    notes = (load["said"] or "").split("; ")
    body = read_machine_section(about)
    timezone, duration_s = str(body.get("timezone", "UTC")), float(frames["shift"]["duration_s"][0])
    clock = ShiftClock(timezone, about.t0_unix_ns, duration_s)
    return ReviewState(
        key=inputs_digest,
        recording_sha256=recording_sha256,
        inputs=about.inputs,
        resolved=resolved_settings,
        t0_unix_ns=about.t0_unix_ns,
        machine=read_machine_name(about),
        begins=format_local_time(about),
        can_weigh=verdict.can_weigh,
        failed=tuple(
            FailedCheck(
                check=check.check,
                value=check.value,
                limit=check.limit_text,
                consequence=check.consequence,
                meaning=check.meaning,
                remedy=check.remedy,
            )
            for check in verdict.checks
            if check.passed is False and check.about == "mass"
        ),
        losses=tuple(map(str, about.losses)),
        notes=about.notes,
        gate_shares={name: share for name, share in shares.iter_rows() if name is not None},
        gaps_s=tuple((start / NS, end / NS) for start, end in gaps),
        sampling=tuple(
            _summarise_topic_sampling(name.removeprefix("raw/"), frame)
            for name, frame in frames.items()
            if name.startswith("raw/")
        ),
        friction=(load["friction_x_N_s_m"], load["friction_x_std_N_s_m"]),
        friction_parts=fit_viscous_friction_by_shift_part(
            frames["excitation"], frames["manoeuvres"], frames["nuisances"], about.settings
        ),
        digs=frames["digging"].height,
        findings=tuple(
            format_finding(e, clock) for e in read_findings_of_run(run) if e.severity != "tell"
        ),
        no_cycle=describe_missing_cycles(frames["cycles"], frames["loads"]),
        unweighed_drives=next((n for n in notes if n.endswith(UNWEIGHED_DRIVES)), ""),
        mixed_machines=mixed_machines_warning,
        timezone=timezone,
        serial=str(body.get("id") or ""),
        duration_s=duration_s,
        motions=tuple(summarise_cycle_motion(frames["cycles"], frames["excitation"], gaps)),
        motion=summarise_shift_motion(frames["excitation"], gaps),
        idle_s=tuple((s / NS, e / NS) for s, e in find_idle_spans_ns(frames["excitation"])),
        torn=truncated_logs,
        energy=energy,
    )


def read_review_state(folder: Path) -> ReviewState | None:
    """Read the state of an earlier review; None if absent or in another format."""
    try:
        state = ReviewState.model_validate_json((folder / STATE).read_bytes())
    except (OSError, ValidationError):
        return None
    return state if state.format == FORMAT else None


class ChangedSetting(NamedTuple):
    """Setting that differs from an earlier review, as text."""

    name: str
    old_value: str
    new_value: str


def list_changed_settings(
    previous_state: ReviewState | None, resolved_settings: dict[str, Any]
) -> list[ChangedSetting]:
    """List the settings that changed since the previous review: name, old and new value.

    Args:
        previous_state: state of the previous review.
        resolved_settings: settings of this review.
    """
    if previous_state is None:
        return []
    old, new = (
        flatten_values_to_texts(previous_state.resolved),
        flatten_values_to_texts(resolved_settings),
    )
    return [
        ChangedSetting(name, old.get(name, "–"), new.get(name, "–"))
        for name in sorted(old.keys() | new.keys())
        if old.get(name) != new.get(name)
    ]


def flatten_values_to_texts(nested_values: Any, dotted_prefix: str = "") -> dict[str, str]:
    """Flatten nested values to texts, by dotted name."""
    if isinstance(nested_values, dict):
        found: dict[str, str] = {}
        for key, value in nested_values.items():  # pyright: ignore[reportUnknownVariableType]
            found |= flatten_values_to_texts(
                value, f"{dotted_prefix}.{key}" if dotted_prefix else str(key)
            )  # pyright: ignore[reportUnknownArgumentType]
        return found
    return {dotted_prefix: str(nested_values)}


def describe_missing_cycles(cycles: pl.DataFrame, loads: pl.DataFrame) -> str:
    """Say why there is no cycle; empty if there is one."""
    if cycles.height:
        return ""
    if loads["withheld"].all():
        return str(loads["withheld_for"][0])
    if loads.height == 1:
        said = loads["said"][0] or ""
        starts = format_count(int(loads["manoeuvres"][0]), "usable start")
        return f"{starts}, {said if SINGLE_LOAD_PROBABILITY in said else 'one load throughout'}"
    return f"none of {loads.height} load states can be identified as loaded or empty"


def _summarise_topic_sampling(topic: str, topic_frame: pl.DataFrame) -> TopicSampling:
    """Summarise a topic's messages: rate, longest step and fraction of late ones."""
    steps = np.diff(topic_frame["log_time_ns"].to_numpy()) / NS
    middle = float(np.median(steps)) if steps.size else 0.0
    known = middle > 0.0
    return TopicSampling(
        topic=topic,
        messages=topic_frame.height,
        rate_hz=1.0 / middle if known else None,
        longest_s=float(steps.max()) if steps.size else None,
        late_1=float((steps > LIMITS.late_message_periods * middle).mean()) if known else None,
    )
