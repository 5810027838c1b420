"""Replay logs under every combination of the values that `--over KEY=…` gives."""

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from decimal import Decimal
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import polars as pl

from analysis.calibration.campaign.campaign_readings import average_masses_by_method_and_run
from analysis.calibration.campaign.method_errors import add_calibrated_mass_error_columns
from analysis.model.answer import Answer, make_answer
from analysis.model.machine import LogSection, Machine
from analysis.model.run_record import Run
from estimators.errors import DataError, MachineError
from replay.inputs.derived_logs import CachedLog
from replay.logs import open_log
from replay.machines.machine_file import find_time_axis_of_machine, load_machine
from replay.pipeline import run
from replay.runs.run_limits import LIMITS
from replay.simulation.log_truth import do_logs_have_truth_of_trials, read_true_trials_of_logs

if TYPE_CHECKING:
    from replay.calibration.apply_evidence import CalibrationRequest, MachineCalibration

_HOW = "write it as KEY=FROM:TO:STEP or KEY=A,B,C, as settings.gate.threshold_nat=0.5:1.5:0.2"


@dataclass(frozen=True, slots=True)
class SweepRow:
    """Result for one combination: its overrides, the answer, and the answer's errors.

    `errors` has by name and method: `error_kg`, the log's mass minus the reference; with the truth
    beside the logs, `rmse_kg` of the runs' raw masses; with three loads or more, also
    `calibrated_rmse_kg` and `left_out_rmse_kg` of the runs' masses after (19), with and without the
    run's own load in the fit. None if the log cannot weigh.
    """

    over: dict[str, str]
    answer: Answer
    errors: dict[str, dict[str, float | None]]


def sweep_setting_combinations(
    logs: Sequence[Path],
    machine_file: Path,
    overrides: Sequence[str],
    grid: Sequence[Sequence[str]],
    *,
    reference_kg: float | None,
    calibration: "CalibrationRequest | None" = None,
    on_stage: Callable[[str], None],
) -> list[SweepRow]:
    """Replay logs on one time line for each combination; each topic is decoded once.

    Args:
        logs: logs; errors are computed if the truth is beside each log.
        machine_file: the machine file.
        overrides: `key=value` for every combination.
        grid: combinations of further overrides (`list_value_combinations`).
        reference_kg: true mass, if known.
        calibration: evidence that calibrates the masses of combinations with its settings; the
            other answers state why their masses are not calibrated.
        on_stage: called with each combination as it begins.

    Returns:
        One row per combination.

    Raises:
        PayscopeError: the input is invalid; raised before the first replay.
    """
    machines = [load_machine(machine_file, [*overrides, *each]) for each in grid]
    by: MachineCalibration | None = None
    if calibration is not None:
        # imported only when needed, so that a sweep begins sooner
        from replay.calibration.apply_evidence import load_and_verify_calibration

        by = load_and_verify_calibration(calibration)
        by.require_calibrated_machine(
            by.copy_machine_with_calibrated_settings(load_machine(machine_file, overrides)),
            machine_file,
        )
        machines = [by.copy_machine_with_calibrated_settings(machine) for machine in machines]
    truth = read_true_trials_of_logs(logs) if do_logs_have_truth_of_trials(logs) else None
    rows: list[SweepRow] = []
    with ExitStack() as stack:
        opened: dict[LogSection, list[CachedLog]] = {}
        for each, machine in zip(grid, machines, strict=True):
            on_stage(" ".join(part.removeprefix("settings.") for part in each))
            if machine.log not in opened:
                opened[machine.log] = [
                    CachedLog(
                        stack.enter_context(open_log(path, time=find_time_axis_of_machine(machine)))
                    )
                    for path in logs
                ]
            if by is not None:
                by.refuse_logs_of_other_machine(opened[machine.log])
            replayed = _replay_and_name_settings_in_errors(
                opened[machine.log], machine, logs, machine_file, each
            )
            if by is not None:
                replayed = by.calibrate_masses_of_run(
                    replayed, by.list_differing_settings_as_text(machine)
                )
            answer = make_answer(replayed)
            errors: dict[str, dict[str, float | None]] = {}
            if reference_kg is not None:
                errors["error_kg"] = {
                    method: None if mass is None else mass - reference_kg
                    for row in answer.rows
                    for method, mass in row.quantities["mass_kg"].items()
                }
            if truth is not None:
                errors |= compute_rms_errors_of_masses(
                    replayed, truth, can_weigh=answer.verdict.can_weigh
                )
            values = dict(part.split("=", 1) for part in each)
            rows.append(SweepRow(values, answer, errors))
    return rows


def _replay_and_name_settings_in_errors(
    logs: Sequence[CachedLog],
    machine: Machine,
    paths: Sequence[Path],
    machine_file: Path,
    overrides: Sequence[str],
) -> Run:
    try:
        return run(logs, machine)
    except DataError as error:
        names = ", ".join(map(str, paths))
        raise DataError(f"{names} with {machine_file}, {', '.join(overrides)}: {error}") from None


def compute_rms_errors_of_masses(
    replayed_run: Run, true_trials: pl.DataFrame, *, can_weigh: bool
) -> dict[str, dict[str, float | None]]:
    """Compute root mean square errors of the runs' masses in kg, by name and method."""
    estimates = average_masses_by_method_and_run(replayed_run, true_trials)
    errors = add_calibrated_mass_error_columns(estimates).with_columns(
        raw_kg=pl.col("mass_kg") - pl.col("reference_kg")
    )
    names = {"rmse_kg": "raw_kg"}
    if true_trials["load_kg"].n_unique() >= LIMITS.calibration_min_loads:
        names |= {"calibrated_rmse_kg": "error_kg", "left_out_rmse_kg": "error_left_out_kg"}
    by_method = {str(method): part for (method,), part in errors.group_by("method")}
    return {
        name: {
            method: _compute_rms_error(by_method[method][column])
            if can_weigh and method in by_method
            else None
            for method in replayed_run.frames["masses"]["method"]
        }
        for name, column in names.items()
    }


def _compute_rms_error(errors: pl.Series) -> float | None:
    known = errors.drop_nulls().to_numpy()
    return float(np.sqrt((known**2).mean())) if known.size else None


def list_value_combinations(options: Sequence[str]) -> list[tuple[str, ...]]:
    """List every combination of the requested values.

    Args:
        options: `key=from:to:step` (both ends included) or `key=a,b,c`.

    Returns:
        Combinations, each as overrides `key=value` in the order of `options`; the last varies
        fastest.

    Raises:
        MachineError: --over is not a range or list, or gives a key twice; one line.
    """
    axes = [parse_swept_option(each) for each in options]
    keys = [axis[0].partition("=")[0] for axis in axes]
    for key in keys:
        if keys.count(key) > 1:
            raise MachineError(f"--over {key}: is given twice; put all its values into one --over")
    size = 1
    for axis in axes:
        size *= len(axis)
    if size > LIMITS.max_grid_points:
        raise MachineError(
            f"--over: makes {size:,} replays, but at most {LIMITS.max_grid_points:,} are allowed; "
            "use larger steps"
        )
    return list(product(*axes))


def parse_swept_option(option: str) -> list[str]:
    """Parse an --over option to its overrides, `key=value`."""
    key, equals, text = (part.strip() for part in option.partition("="))
    if not (key and equals and text):
        raise MachineError(f"--over {option}: {_HOW}")
    values = parse_swept_range(option, text) if ":" in text else split_values_outside_brackets(text)
    if not all(values):
        raise MachineError(f"--over {option}: a value is missing; {_HOW}")
    return [f"{key}={value}" for value in values]


def parse_swept_range(option: str, text: str) -> list[str]:
    """List the decimal numbers of the range `from:to:step`, as text."""
    try:
        first, last, step = (Decimal(part.strip()) for part in text.split(":"))
        steps = (last - first) / step
    except (ArithmeticError, ValueError):
        raise MachineError(f"--over {option}: {_HOW}") from None
    if not steps.is_finite() or steps < 0:
        raise MachineError(
            f"--over {option}: steps of {step} do not lead from {first} to {last}; give finite "
            "numbers, and a step of the right sign"
        )
    if steps >= LIMITS.max_grid_points:
        raise MachineError(
            f"--over {option}: makes more than {LIMITS.max_grid_points:,} values; use a larger step"
        )
    return [f"{first + k * step:f}" for k in range(int(steps) + 1)]


def split_values_outside_brackets(text: str) -> list[str]:
    """Split values at commas, but not inside brackets."""
    values, depth = [""], 0
    for letter in text:
        depth += (letter in "[{") - (letter in "]}")
        if letter == "," and depth == 0:
            values.append("")
        else:
            values[-1] += letter
    return [value.strip() for value in values]
