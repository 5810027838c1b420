"""Draft a campaign file from a folder of logs, for `payscope init --campaign`."""

import datetime as dt
import os
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Final, NamedTuple

import polars as pl

from analysis.model.machine import Machine
from analysis.stages.signals.timestamps import FIRST_DATE_NS
from estimators.errors import CampaignError, OutputError, PayscopeError
from recordings.report.atomic_output import refuse_input_as_output
from replay.logs import Log, open_log
from replay.machines.machine_file import find_time_axis_of_machine, load_machine
from replay.machines.toml_file import format_toml
from replay.pipeline import run

_HEAD = """\
# A first campaign file for {count} in this folder: check every line, complete each TODO.
# `payscope calibrate {name} -o evidence` then replays every run and writes the evidence.

[campaign]
title = ""
intended_use = "TODO: what the calibration is for"
author = "TODO: who made it"
author_function = "TODO: the author's function"
authoriser = "TODO: who answers for it"
authoriser_function = "TODO: the authoriser's function"
place = "TODO: where the runs were made"
place_kind = "customer"        # whose place: laboratory, customer or other
deviations = "none"            # from the method
# received = 2030-01-31        # when the machine was handed over
# replaces = ""                # id of the evidence that this one replaces
# replaces_reason = ""
signer = ""                    # whose key signs
valid_days = 365               # after the last run

# ISO/IEC 17025, 7.8: with a laboratory the evidence is a certificate, and has to have everything
# that one needs. Leave [laboratory] out for evidence of your own.
[laboratory]
name = "TODO"
address = "TODO: street and number"
city = "TODO: postal code and city"
country = "TODO: two letters, such as DE"
email = ""

[customer]
name = "TODO"
address = "TODO: street and number"
city = "TODO: postal code and city"
country = "TODO: two letters"

[machine]
file = {machine}
id = {id}
make = "TODO: who built it"
model = "TODO"
condition = "TODO: such as tyres worn by a third"
# empty_mass_kg = 3614.0       # weighed without load, where not the machine file's
# empty_mass_u_kg = 2.0        # standard uncertainty (k = 1) of empty_mass_kg
# empty_certificate = ""
# empty_expires = 2030-12-31

[machine.parts]                # ids of what the calibration depends on
# torque_sensors = ""
# bucket = ""
# firmware = ""

# One block a reference mass. Masses weighed on one scale share a part of their uncertainty.
[[masses]]
id = "mass-1"
value_kg = 50.0
u_kg = 0.05                    # standard uncertainty (k = 1)
certificate = "TODO"           # its number; "" without
# stated_by = "customer"       # where the customer says the mass, and no laboratory
# dcc = "certificate.xml#item" # read from a digital certificate; then without value_kg and u_kg
# expires = 2030-12-31
# source = "scale-1"
# shared_u_kg = 0.04

[conditions]                   # of all runs; a run may have its own
surface = "TODO: such as dry concrete"
slope_deg = "TODO: of the ground, nose up"
tyres = "TODO: such as 3.5 bar"
fuel = "TODO: such as half full"
temperature_degC = "TODO: of the air"

[method]
estimator = "joint_mass"       # or joint_payload, or a method of the paper such as pooled

# [decision]                   # for a statement on error limits
# accuracy_class = "OIML R 51 Y(b)"
# scale_interval_kg = 20.0
"""


#: Suffixes of files that are meant to be logs; one that cannot be read is reported.
_SUFFIXES: Final = (".bag", ".mcap", ".db3", ".csv", ".parquet")


class CampaignDraft(NamedTuple):
    """Text of a draft, and what must be completed by hand."""

    text: str
    open_items: list[str]


def draft_campaign_file(
    log_folder: Path, campaign_path: Path, machine_file: Path | None
) -> CampaignDraft:
    """Draft a campaign file for the logs of a folder.

    Args:
        log_folder: folder with the logs.
        campaign_path: campaign file; paths of logs are relative to its folder.
        machine_file: machine file; with it, every log is replayed, and a log with several load
            states gives several runs.

    Returns:
        Text of the file, and a sentence about each part that could not be drafted.

    Raises:
        CampaignError: the folder does not exist or has no log, or the campaign file is not in the
            folder or one above it.
        OutputError: the file would replace one of the logs.
    """
    if not log_folder.is_dir():
        raise CampaignError(f"{log_folder}: no such folder; give one with logs")
    machine = None if machine_file is None else load_machine(machine_file)
    blocks: list[str] = []
    said: list[str] = []
    for path in sorted(log_folder.iterdir()):
        if path.name.startswith("."):
            continue
        try:
            with open_log(
                path, time=find_time_axis_of_machine(machine) if machine else None
            ) as log:
                refuse_input_as_output(campaign_path, log.files)
                blocks += _iter_toml_blocks_of_campaign_runs(
                    log, _make_relative_path(campaign_path.parent, path), machine
                )
        except OutputError:
            raise
        except PayscopeError as fault:
            if (path / "metadata.yaml").exists() or path.suffix in _SUFFIXES:
                refuse_input_as_output(campaign_path, [path])
                said.append(f"left out: {fault}")
    if not blocks:
        raise CampaignError(f"{log_folder}: contains no readable log; give a folder with logs")
    file = (
        "machine.toml"
        if machine_file is None
        else _make_relative_path(campaign_path.parent, machine_file)
    )
    named = None if machine is None else machine.machine.id or machine.machine.name
    name = named or "machine-1"
    ids = "".join(c if c.isascii() and c.isalnum() else "-" for c in name).strip("-")[:60]
    count = f"{len(blocks)} run{'' if len(blocks) == 1 else 's'}"
    head = _HEAD.format(
        count=count,
        name=format_toml(campaign_path.name)[1:-1],
        machine=format_toml(file),
        id=format_toml(ids or "machine-1"),
    )
    return CampaignDraft("\n".join([head, *blocks]), said)


def _iter_toml_blocks_of_campaign_runs(
    log: Log, log_name: str, machine: Machine | None
) -> Iterator[str]:
    """Yield a TOML block for each run: the whole log, or a load state."""
    topics = log.topics()
    start_ns = topics["start_ns"].min()
    dated = isinstance(start_ns, int) and start_ns >= FIRST_DATE_NS
    zone = dt.UTC if machine is None else machine.machine.time_zone
    day = (
        f"{dt.datetime.fromtimestamp(start_ns // 10**9, zone):%Y-%m-%d}"
        if dated and isinstance(start_ns, int)
        else '"TODO"                    # this log has no date'
    )
    for span_lines, mass in _draft_load_state_spans(log, machine):
        lines = [
            "[[runs]]",
            f"log = {format_toml(log_name)}",
            *span_lines,
            f'loads = ["TODO"]               # ids of the masses on board; [] without load{mass}',
            f"day = {day}",
            'operator = ""',
            "",
        ]
        yield "\n".join(lines)


class _LoadStateDraft(NamedTuple):
    """TOML lines of a run with one load state, and its estimated mass as text."""

    lines: list[str]
    mass_text: str


def _draft_load_state_spans(log: Log, machine: Machine | None) -> Iterator[_LoadStateDraft]:
    """Yield the TOML lines with start and end of each load state, and its estimated mass."""
    loads = pl.DataFrame() if machine is None else run(log, machine).frames["loads"]
    rows = loads.to_dicts()
    if len(rows) < 2:
        seen = f"; {rows[0]['mass_kg']:.0f} kg uncalibrated" if rows and rows[0]["mass_kg"] else ""
        yield _LoadStateDraft([], seen)
        return
    # a run ends midway between two loads, while the machine stood
    middles = [(before["end_t_ns"] + after["start_t_ns"]) / 2e9 for before, after in pairwise(rows)]
    for row, start, end in zip(rows, [None, *middles], [*middles, None], strict=True):
        stretch = [
            *([] if start is None else [f"from_s = {start:.1f}"]),
            *([] if end is None else [f"to_s = {end:.1f}"]),
        ]
        yield _LoadStateDraft(
            stretch, f"; {row['mass_kg']:.0f} kg uncalibrated" if row["mass_kg"] else ""
        )


def _make_relative_path(base_folder: Path, path: Path) -> str:
    """Path relative to a folder; never absolute, so that the file can be moved."""
    return Path(os.path.relpath(path.resolve(), base_folder.resolve())).as_posix()
