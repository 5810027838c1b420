"""The paper's method on one screen: log → align → smooth → forces → gate → weigh → trace → Run."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import polars as pl

from analysis.cycles.cycles import weigh_cycles
from analysis.cycles.shift_totals import estimate_min_detectable_load_kg, make_shift_totals_frame
from analysis.diagnosis import (
    CheckInputs,
    add_check_of_invalidating_findings,
    collect_raw_signals,
    compare_methods_with_joint_fit,
    judge_log_by_checks,
    refit_without_failing_stretches,
)
from analysis.findings import (
    FindingInputs,
    add_masked_findings,
    cut_to_first_hour,
    drop_findings_explained_by_work_cycles,
    find_causes,
)
from analysis.model.loss import Loss
from analysis.model.machine import Machine
from analysis.model.run_record import Run
from analysis.model.verdict import Verdict
from analysis.planar.centre_of_mass import make_planar_frames
from analysis.stages.estimation.method_estimates import (
    list_reasons_for_no_answer,
    summarise_masses,
    trace_estimates,
    withhold_masses,
)
from analysis.stages.gating.digging import (
    add_column_of_digging_starts,
    find_digging_starts,
    reject_windows_with_digging,
)
from analysis.stages.gating.gate import gate_windows
from analysis.stages.gating.segments import estimate_each_manoeuvre_by_pooling
from analysis.stages.motion.forces import compute_excitation
from analysis.stages.motion.smooth import smooth_by_trailing_mean
from analysis.stages.noise.channel_noise import estimate_channel_noise
from analysis.stages.noise.channel_noise import list_noise_source_notes as noise_notes
from analysis.stages.signals.align import align_channels_on_grid
from analysis.stages.signals.align import list_alignment_notes as grid_notes
from analysis.stages.signals.copied_rows import (
    Copy,
    drop_copied_rows,
    find_copied_rows_by_topic,
    list_copied_row_notes,
)
from analysis.stages.signals.derive import derive_channels_in_si, read_measured_channels
from analysis.stages.signals.grid_rate import choose_grid_rate_by_log
from analysis.stages.signals.held_readings import (
    drop_rows_with_held_readings,
    find_held_channels,
    list_held_reading_notes,
)
from analysis.stages.signals.mounting import Series
from analysis.stages.signals.speed_threshold import (
    drop_zero_readings_beside_motion,
    find_zero_speed_thresholds_m_s,
    list_speed_threshold_notes,
)
from analysis.stages.signals.timestamps import assign_timestamps
from analysis.weighing.empty_mass_datum import list_notes_on_outdated_tickets
from analysis.weighing.fuel_on_board import FuelOnBoard
from analysis.weighing.learnt_means import make_learnt_mean_frames
from analysis.weighing.load_frames import (
    find_load_change_rows,
    make_load_frame,
    make_manoeuvre_frame,
)
from analysis.weighing.nuisance_frames import make_budget_frame, make_nuisance_frame
from analysis.weighing.weigh import Weighing, weigh
from estimators.errors import DataError
from estimators.threads import limit_blas_to_one_thread, return_freed_memory_to_os
from replay.inputs.channel_inputs import (
    list_channel_fields,
    make_provenance_of_inputs,
    name_raw_frames_by_topic,
    read_channel_fields_and_losses,
)
from replay.inputs.derived_logs import assign_own_topics_to_parallel_tables
from replay.inputs.machine_identity import identify_machine_and_logged_id
from replay.inputs.time_line import compute_log_offsets_ns
from replay.inputs.time_line import describe_log_order as order_note
from replay.logs import Log

#: Names with which `on_stage` is called, in order.
STAGES: Final = (
    *("read", "derive", "align", "smooth", "forces"),
    *("noise", "gate", "weigh", "segments", "trace", "verdict", "findings", "planar", "cycles"),
)


@dataclass(frozen=True)
class _TopicChannels:
    """Channels read from topics, in SI units, with time stamps.

    Attributes:
        read: channel readings at their own rates, by channel.
        stamp_label_by_topic: kind of stamp that times each topic.
        doubts: data whose loss cannot be proven.
        notes: notes on rows and readings that are not used.
        copied: rows of topics that repeat earlier ones, by topic.
    """

    read: dict[str, Series]
    stamp_label_by_topic: dict[str, str]
    doubts: list[Loss]
    notes: list[str]
    copied: dict[str, list[Copy]]

    @classmethod
    def from_topics(
        cls, raw_frames: Mapping[str, pl.DataFrame], machine: Machine
    ) -> "_TopicChannels":
        """Assign a time to every sample, and read the channels of the machine file."""
        copied = find_copied_rows_by_topic(raw_frames)  # a logger wrote a buffer twice
        placed, stamps, doubts = assign_timestamps(drop_copied_rows(raw_frames, copied))
        read, missing = read_measured_channels(placed, machine)
        held = find_held_channels(read)  # rows that repeat a slow sensor's last reading
        notes = [*list_copied_row_notes(copied), *list_held_reading_notes(read, held)]
        read = drop_rows_with_held_readings(read, held)
        # an accelerometer shows a start that the speed does not
        thresholds_m_s = (
            find_zero_speed_thresholds_m_s(read) if machine.differentiates_speed else {}
        )
        read = drop_zero_readings_beside_motion(read, thresholds_m_s)
        notes += list_speed_threshold_notes(thresholds_m_s)
        return cls(read, stamps, [*doubts, *missing], notes, copied)


@dataclass(frozen=True)
class _StageResults:
    """Results of the stages up to the findings.

    Attributes:
        frames: frames of the run, up to the verdict.
        weighing: the joint fit.
        finding_inputs: inputs of the search for causes.
        totals: masses of the whole log, before any is withheld.
        contradicted: methods whose mass the log contradicts.
        stamp_label_by_topic: kind of stamp that times each topic.
        doubts: data whose loss cannot be proven.
        notes: notes for the reader.
    """

    frames: dict[str, pl.DataFrame]
    weighing: Weighing | None
    finding_inputs: FindingInputs
    totals: pl.DataFrame
    contradicted: list[str]
    stamp_label_by_topic: dict[str, str]
    doubts: list[Loss]
    notes: list[str]


@limit_blas_to_one_thread()  # else the last bits depend on the number of cores
def run(
    logs: Log | Sequence[Log], machine: Machine, on_stage: Callable[[str], None] = lambda _: None
) -> Run:
    """Replay one or more logs on one time line through all stages.

    Args:
        logs: opened logs (`open_log`).
        machine: channels and settings (`load_machine`).
        on_stage: called with the name of each stage when it begins.

    Returns:
        Every intermediate frame, with the provenance.
    """
    logs, machine = assign_own_topics_to_parallel_tables(
        logs if isinstance(logs, Sequence) else [logs], machine
    )
    machine, logged_id = identify_machine_and_logged_id(logs, machine)  # a sister's log is refused

    on_stage("read")  # the channels in use, at their own rates
    raw, losses = read_channel_fields_and_losses(logs, machine)
    placed = _TopicChannels.from_topics(raw, machine)
    machine, chosen = choose_grid_rate_by_log(placed.read, machine)  # what no setting gives
    chosen = [*placed.notes, *chosen]
    return_freed_memory_to_os()  # what decoding needed is half a gigabyte of a shift
    seen = _run_stages(raw, placed, machine, on_stage)
    del placed  # of a shift it is half a gigabyte
    weighing, excitation = seen.weighing, seen.frames["excitation"]
    return_freed_memory_to_os()  # refits of findings allocate rows as large as those of the fit
    on_stage("findings")  # named causes of a bad estimate, with what mending each would do
    causes = _find_causes_of_log(seen, raw, machine)
    judged = add_check_of_invalidating_findings(seen.finding_inputs.verdict_frame, causes, machine)
    opinion = Verdict.from_frame(judged)
    on_stage("planar")  # the centre of mass from arcs (9), and all six from joint motion
    plane, plane_budget = make_planar_frames(
        excitation, seen.frames["gate"], opinion, machine, seen.frames["noise"]
    )
    return_freed_memory_to_os()  # of a shift what findings needed is hundreds of megabytes
    on_stage("cycles")  # load states in time, their payloads, and the sum of the shift
    manoeuvres = make_manoeuvre_frame(weighing, excitation, machine)
    answer = {
        "loads": make_load_frame(
            weighing,
            excitation,
            manoeuvres,
            machine,
            opinion,
            FuelOnBoard.integrate_fuel_rate(machine.machine, seen.frames["aligned"]),
        ),
        "manoeuvres": manoeuvres,
    }
    hauled = weigh_cycles(weighing, {**seen.frames, **answer}, machine, opinion)

    why = list_reasons_for_no_answer(excitation, seen.frames["gate"], machine.settings)
    return Run(
        frames={
            **name_raw_frames_by_topic(raw),
            **seen.frames,
            "planar": plane,
            "planar_budget": plane_budget,
            **answer,
            "cycles": hauled.cycles,
            "shift": make_shift_totals_frame(
                hauled.cycles,
                excitation,
                seen.frames["aligned"],
                hauled.scale,
                estimate_min_detectable_load_kg(answer["manoeuvres"], answer["loads"]),
            ),
            "nuisances": make_nuisance_frame(weighing),
            **make_learnt_mean_frames(weighing, machine, answer["loads"], hauled.sums),
            "budget": make_budget_frame(weighing, machine),
            "masses": withhold_masses(seen.totals, opinion, seen.contradicted),
            "verdict": judged,
            "findings": drop_findings_explained_by_work_cycles(causes, hauled.cycles),
        },
        provenance=make_provenance_of_inputs(
            logs,
            machine,
            seen.finding_inputs.check_inputs.t0_unix_ns,
            seen.stamp_label_by_topic,
            logged_machine_id=logged_id,
            # a recording that is replayed has its own again
            losses=list(dict.fromkeys([*losses, *seen.doubts])),
            notes=[
                *(note for log in logs for note in log.notes()),
                *order_note(compute_log_offsets_ns(logs, list_channel_fields(machine))),
                *chosen,
                *seen.notes,
                *list_notes_on_outdated_tickets(
                    machine.machine, seen.finding_inputs.check_inputs.t0_unix_ns
                ),
                *why,
            ],
        ),
    ).with_fingerprint()


def _run_stages(
    raw_frames: Mapping[str, pl.DataFrame],
    topic_channels: _TopicChannels,
    machine: Machine,
    on_stage: Callable[[str], None],
) -> _StageResults:
    settings, read = machine.settings, topic_channels.read
    on_stage("derive")  # one filter on all of them where one is differentiated
    channels, notes = derive_channels_in_si(read, machine)
    on_stage("align")  # one grid, on the line between two samples, never over a gap
    aligned, t0_unix_ns = align_channels_on_grid(channels, machine)
    notes += grid_notes(channels, machine)
    del channels  # of a shift they are half a gigabyte
    on_stage("smooth")  # the trailing moving mean, alike on every column
    smoothed = smooth_by_trailing_mean(aligned, settings.smooth)
    on_stage("forces")  # (17), (18), gravity as specific force; the phase of motion
    excitation = compute_excitation(smoothed, machine)
    del smoothed
    on_stage("noise")  # of every column, from standstill and fast changes
    noise = estimate_channel_noise(aligned, excitation, machine, read)
    notes += noise_notes(noise)
    on_stage("gate")  # the index (11) over each window, and a reason for each
    gated = gate_windows(excitation, settings, noise)
    digs = find_digging_starts(excitation, machine)  # what pushes back is no mass
    gated = reject_windows_with_digging(gated, excitation, digs, machine)
    return_freed_memory_to_os()
    on_stage("weigh")  # load states, and the joint fit: their masses, nuisances under priors
    stamps = topic_channels.stamp_label_by_topic
    seen = collect_raw_signals(raw_frames, stamps, read, machine)
    # nor does what repeats itself count, if the answer is the same without it
    refitted = refit_without_failing_stretches(
        seen,
        (add_column_of_digging_starts(aligned, digs), t0_unix_ns),
        gated,
        machine,
        lambda grid: weigh(grid, excitation, gated, noise, machine),
    )
    weighing, gated = refitted.weighing, refitted.gated
    return_freed_memory_to_os()  # of a shift a gigabyte
    on_stage("segments")  # pooled over each manoeuvre
    table = estimate_each_manoeuvre_by_pooling(excitation, gated, settings, noise)
    on_stage("trace")  # the estimators over the accepted windows; recursions load by load
    estimates = trace_estimates(excitation, gated, settings, noise, find_load_change_rows(weighing))
    on_stage("verdict")  # what the ungated log, and that fit, say of all this
    everything = summarise_masses(excitation, gated, estimates, machine, noise)
    evidence = CheckInputs(
        excitation, gated, machine, weighing, seen, everything, t0_unix_ns, noise, refitted.named
    )
    judged = judge_log_by_checks(evidence)
    contradicted = [
        each.method for each in compare_methods_with_joint_fit(evidence) if each.contradicted
    ]
    return _StageResults(
        {
            "aligned": aligned,
            "excitation": excitation,
            "noise": noise,
            "gate": gated,
            "digging": digs,
            **{f"estimates/{method}": frame for method, frame in estimates.items()},
            "segments": table,
        },
        weighing,
        FindingInputs(
            evidence, aligned, noise, raw_frames, digs, judged, topic_channels.copied, estimates
        ),
        everything,
        contradicted,
        topic_channels.stamp_label_by_topic,
        topic_channels.doubts,
        notes,
    )


def _find_causes_of_log(
    stages: _StageResults, raw_frames: Mapping[str, pl.DataFrame], machine: Machine
) -> pl.DataFrame:
    """Find the causes in the log, and further ones by replays with a masking cause corrected."""
    part = cut_to_first_hour(raw_frames)

    def find_causes_with(changed: Machine) -> pl.DataFrame | None:
        try:
            placed = _TopicChannels.from_topics(part, changed)
            return find_causes(_run_stages(part, placed, changed, lambda _: None).finding_inputs)
        except DataError:  # the first hour of a log may have too little data
            return None

    whole = all(part[topic].height == frame.height for topic, frame in raw_frames.items())
    return add_masked_findings(
        find_causes(stages.finding_inputs), machine, find_causes_with, is_complete_log=whole
    )
