"""The demo: simulate the paper's campaign as logs, calibrate and verify; review a shift."""

import datetime as dt
import shutil
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import polars as pl

from analysis import Machine, Run
from analysis.calibration.campaign.by_method import (
    fit_calibration_line_by_method,
    make_calibration_frame,
    make_calibration_rows_of_method,
)
from analysis.calibration.campaign.campaign_readings import average_masses_by_method_and_run
from analysis.calibration.campaign.method_errors import compute_rms_mass_errors_by_method
from analysis.model.answer import JOINT, Answer, make_answer
from analysis.simulation import Scenario
from analysis.simulation.scenario.shift_plan import SimulatedShift
from estimators.errors import OutputError
from recordings import plot_run, write_recording
from recordings.calibration.bundle_folder import EVIDENCE
from recordings.report.atomic_output import (
    require_writable_folder,
    require_writable_output,
    stage_output_file,
)
from recordings.signatures.signing import generate_key_pair_pem
from replay.calibration.apply_evidence import CalibrationRequest
from replay.calibration.calibrate_campaign import CalibrationOutcome, calibrate_from_campaign
from replay.calibration.verify_bundle import Verification, verify_bundle
from replay.logs import open_log
from replay.machines.machine_file import (
    find_machine_file_or_shipped_one,
    find_time_axis_of_machine,
    load_machine,
)
from replay.pipeline import STAGES, run
from replay.review.review_folder import refuse_unsuitable_review_folder
from replay.review.review_shift import ReviewOptions, review_shift
from replay.review.write_review import ShiftReview
from replay.simulation.log_truth import make_truth_path_of_log, read_true_trials_of_logs
from replay.simulation.simulate_logs import (
    make_paths_of_simulated_logs,
    make_shift_truth_path,
    simulate_scenario_to_logs,
)

_HEAD = """\
# The demo's calibration: simulated logs. The certificates are examples and stand for none:
# a simulated mass is exactly known. docs/evidence.md explains every key.

[campaign]
title = "Demo: simulated Cat 262C"
intended_use = "showing what a calibration is"
author = "payscope demo"
author_function = "simulation"
authoriser = "payscope demo"
authoriser_function = "example"
place = "simulated"
place_kind = "other"
deviations = "none"
signer = "payscope demo"

[machine]
file = "{machine}"
id = "simulated"
make = "Caterpillar"
model = "262C"
condition = "simulated"
empty_mass_kg = {empty_kg!r}
empty_mass_u_kg = 0.5
empty_certificate = "example: weighbridge 1"

[conditions]
surface = "simulated, dry concrete"
slope_deg = 0.0
tyres = "simulated, rigid"
fuel = "simulated, constant"
temperature_degC = 20.0

[method]
estimator = "joint_mass"
"""
_MASS = """
[[masses]]
id = "{id}"
value_kg = {value_kg!r}
u_kg = 0.02
certificate = "example: {id}"
"""
_RUN = """
[[runs]]
log = "{log}"
loads = [{loads}]
day = {day}
"""
_MACHINE = Path("cat262c.toml")
#: Names with which `on_stage` is called, in order.
STEPS: Final = ("simulate", "calibrate", "verify", *STAGES, "record", "review")
#: Ten minutes of work with the calibrated machine, with loads in the calibrated range.
_SHIFT: Final = SimulatedShift(
    duration_h=0.15,
    logs=2,
    load_kg=180.0,
    load_std_kg=30.0,
    load_least_kg=120.0,
    load_most_kg=240.0,
    carry_back_kg=4.0,
    carry_back_most_kg=15.0,
    fuel_tank_kg=0.0,
    fuel_kg_h=0.0,
    idle_share=0.0,
)
#: Target payload of a load in the demo's shift, in kg.
_TARGET_KG: Final = 200.0


@dataclass(frozen=True, slots=True)
class DemoResults:
    """Results of the demo, and the files it made."""

    calibrated: CalibrationOutcome
    verified: Verification
    calibration: pl.DataFrame
    errors: pl.DataFrame
    answer: Answer
    reviewed: ShiftReview
    files: tuple[Path, ...]

    def to_dict(self) -> dict[str, Any]:
        """The fields as JSON-compatible values."""
        return {
            "evidence": self.calibrated.to_dict(),
            "verified": self.verified.to_dict(),
            "calibration": self.calibration.to_dicts(),
            "errors": self.errors.to_dicts(),
            "answer": self.answer.to_dict(),
            "review": self.reviewed.to_dict(),
            "files": [str(path) for path in self.files],
        }


def run_demo(
    folder: Path, *, seed: int, overwrites: bool, on_stage: Callable[[str], None]
) -> DemoResults:
    """Simulate a campaign, calibrate, verify the evidence, replay it on one time line, and record.

    Then a shift of the same machine is simulated and reviewed under that evidence.

    Args:
        folder: folder for the files, created if missing.
        seed: seed of the simulated noise.
        overwrites: whether files of an earlier demo may be replaced.
        on_stage: called with the name of each stage when it begins.

    Raises:
        OutputError: a file already exists, or the folder cannot be written to.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be created ({error.strerror})") from error
    machine_file = folder / _MACHINE.name
    recording, picture = folder / "campaign.rrd", folder / "campaign.png"
    campaign_file, evidence = folder / "calibration.toml", folder / "evidence"
    shift, page = folder / "shift.mcap", folder / "review"
    keys = folder / "key.pem", folder / "key.pub.pem"
    scenario = Scenario().copy_with_seed(seed)
    hauling = scenario.model_copy(update={"shift": _SHIFT})
    hauled, truth = make_paths_of_simulated_logs(hauling, shift), make_shift_truth_path(shift)
    for output in (machine_file, campaign_file, *keys, recording, picture, *hauled, truth):
        require_writable_output(output, overwrites=overwrites)
    require_writable_folder(evidence, overwrites=overwrites, marker=EVIDENCE)
    if page.exists() and overwrites:
        refuse_unsuitable_review_folder(page)
    else:
        require_writable_folder(page, overwrites=overwrites)
    with stage_output_file(machine_file, overwrites=overwrites) as partial:
        shutil.copyfile(find_machine_file_or_shipped_one(_MACHINE), partial)
    on_stage("simulate")
    logs = simulate_scenario_to_logs(scenario, folder / "campaign.bag", overwrites=overwrites)
    with stage_output_file(campaign_file, overwrites=overwrites) as partial:
        partial.write_text(
            format_demo_campaign_file(scenario, logs, machine_file.name), encoding="utf-8"
        )
    for path, half in zip(keys, generate_key_pair_pem(), strict=True):
        with stage_output_file(path, overwrites=overwrites) as partial:
            partial.touch(mode=0o600)
            partial.write_bytes(half)
    on_stage("calibrate")
    calibrated = calibrate_from_campaign(
        campaign_file, evidence, key_file=keys[0], overwrites=overwrites
    )
    on_stage("verify")
    verified = verify_bundle(
        evidence, key_file=keys[1], verification_day=calibrated.document.expires
    )
    replayed = replay_simulated_campaign(logs, load_machine(machine_file), on_stage)
    replayed = add_evidence_calibration_line(replayed, calibrated, scenario.machine.mass_kg)
    on_stage("record")
    write_recording(replayed, recording, overwrites=overwrites)
    plot_run(replayed, picture, overwrites=overwrites)
    on_stage("review")
    simulate_scenario_to_logs(hauling, shift, overwrites=overwrites)
    by = CalibrationRequest(evidence, keys[1], is_signature_required=True)
    asked = ReviewOptions(calibration=by, target_kg=_TARGET_KG)
    reviewed = review_shift(hauled, machine_file, page, asked)
    return DemoResults(
        calibrated,
        verified,
        replayed.frames["calibration"],
        compute_rms_mass_errors_by_method(replayed.frames["calibration"]),
        make_answer(replayed, str(recording)),
        reviewed,
        (
            *(*logs, *map(make_truth_path_of_log, logs), machine_file, campaign_file, *keys),
            *(
                evidence,
                recording,
                picture,
                *hauled,
                *map(make_truth_path_of_log, hauled),
                truth,
                page,
            ),
        ),
    )


def add_evidence_calibration_line(
    replayed_run: Run, calibration_outcome: CalibrationOutcome, empty_kg: float
) -> Run:
    """Add the evidence's calibration line to a run, before the lines of the methods."""
    document = calibration_outcome.document
    points = () if document.calibration is None else document.calibration.points
    first = make_calibration_frame(
        make_calibration_rows_of_method(
            JOINT, points, document.calibration, lambda at: at.reference_kg - empty_kg
        )
    )
    both = pl.concat([first, replayed_run.frames["calibration"]])
    return replace(
        replayed_run, frames={**replayed_run.frames, "calibration": both}
    ).with_fingerprint()


def replay_simulated_campaign(
    logs: Sequence[Path], machine: Machine, on_stage: Callable[[str], None] = lambda _: None
) -> Run:
    """Replay simulated logs on one time line, and calibrate each method by the true masses."""
    with ExitStack() as stack:
        opened = [
            stack.enter_context(open_log(path, time=find_time_axis_of_machine(machine)))
            for path in logs
        ]
        replayed = run(opened, machine, on_stage)
    calibration = fit_calibration_line_by_method(
        average_masses_by_method_and_run(replayed, read_true_trials_of_logs(logs))
    )
    frames = {**replayed.frames, "calibration": calibration}
    return replace(replayed, frames=frames).with_fingerprint()


def format_demo_campaign_file(scenario: Scenario, logs: Sequence[Path], machine: str) -> str:
    """Format the campaign file for simulated logs with ascending masses.

    Args:
        scenario: simulated scenario, with loads ascending from 0.
        logs: one log per load.
        machine: path of the machine file, relative to the campaign file.
    """
    loads_kg = scenario.campaign.loads_kg
    names = [f"mass-{number}" for number in range(1, len(loads_kg))]
    steps = zip(names, pairwise(loads_kg), strict=True)
    text = _HEAD.format(machine=machine, empty_kg=scenario.machine.mass_kg)
    text += "".join(_MASS.format(id=name, value_kg=high - low) for name, (low, high) in steps)
    for number, log in enumerate(logs):
        start_ns = read_true_trials_of_logs([log])["start_ns"][0]
        day = dt.datetime.fromtimestamp(start_ns // 10**9, dt.UTC).date()
        on_board = ", ".join(f'"{name}"' for name in names[:number])
        text += _RUN.format(log=log.name, loads=on_board, day=day)
    return text
