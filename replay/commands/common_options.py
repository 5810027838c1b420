"""Options shared by several commands."""

import sys
from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from recordings.signatures.signed_by import SignedBy
    from replay.calibration.apply_evidence import CalibrationRequest
    from replay.logs import TimeAxis


class FrameFormat(StrEnum):
    """Format in which a frame is printed or written."""

    table = "table"
    csv = "csv"
    json = "json"
    parquet = "parquet"
    arrow = "arrow"


Logs = Annotated[
    list[Path],
    typer.Argument(
        help="Logs: .bag, .mcap, rosbag2 or .db3; tables (.csv, .parquet, .jsonl, .xlsx …); .rrd."
    ),
]
FormatOption = Annotated[
    FrameFormat | None,
    typer.Option("--format", help="Default: by the suffix of -o, or else a table."),
]
OutputFile = Annotated[
    Path | None, typer.Option("-o", "--output", help="Write to this file instead of stdout.")
]
#: Option for evidence that calibrates the masses of loads.
Calibration = Annotated[
    Path | None,
    typer.Option("--calibration", metavar="DIR", help="Evidence that calibrates the masses."),
]
SignerKey = Annotated[
    Path | None,
    typer.Option("--key", help="Public key (PEM) that the evidence has to be signed with."),
]
RequireSigned = Annotated[
    bool,
    typer.Option(
        "--require-signed",
        help="Refuse evidence without a signature by --key, or by a key of the keyring.",
    ),
]

#: Option for the viscous friction for which to predict the day on which it is reached.
FrictionLimit = Annotated[
    float | None,
    typer.Option(
        "--friction-limit",
        metavar="N_S_M",
        min=1e-3,
        help="Limit of viscous friction, N·s/m: report the day on which each machine reaches it.",
    ),
]


def make_calibration_request(
    evidence_folder: Path | None, key_file: Path | None, *, is_signature_required: bool
) -> "CalibrationRequest | None":
    """Make a calibration request from the options; None without a calibration.

    Raises:
        BadParameter: an option needs --calibration.
    """
    if evidence_folder is None:
        if key_file is not None or is_signature_required:
            raise typer.BadParameter("--key and --require-signed need --calibration")
        return None
    from replay.calibration.apply_evidence import CalibrationRequest

    return CalibrationRequest(
        evidence_folder, key_file, is_signature_required, make_key_owner_prompt_or_none()
    )


#: Option for properties of a table, for which there is no machine file yet.
LogKeys = Annotated[
    list[str] | None,
    typer.Option(
        "--set", metavar="log.KEY=VALUE", help="Set a key of \\[log] for a table; repeatable."
    ),
]
TimeColumn = Annotated[str | None, typer.Option("--time", help="The time column of a table.")]
TimeUnit = Annotated[
    str | None,
    typer.Option(
        "--time-unit", help="Unit of the time column: s, ms, us or ns; recognised by default."
    ),
]
_UNITS = ("s", "ms", "us", "ns")


def make_time_axis_from_options(
    time_column: str | None, time_unit: str | None, table_keys: list[str] | None = None
) -> "TimeAxis | None":
    """Make the time axis of a table from the options; None to detect it.

    Raises:
        BadParameter: a unit or key is unknown.
    """
    if time_column is None and time_unit is None and not table_keys:
        return None
    from analysis.model.machine import LogSection
    from estimators.errors import MachineError
    from replay.machines.machine_file import find_time_axis_of_section
    from replay.machines.toml_file import set_dotted_key_in_content, validate_toml_content

    if time_unit is not None and time_unit not in _UNITS:
        raise typer.BadParameter(f"no unit of time '{time_unit}'; use {', '.join(_UNITS)}")
    content: dict[str, dict[str, str]] = {"log": {}}
    if time_column is not None:
        content["log"]["time"] = time_column
    if time_unit is not None:
        content["log"]["time_unit"] = time_unit
    for key in table_keys or ():
        if not key.startswith("log."):
            raise typer.BadParameter(
                f"--set {key}: only keys of [log] can be set here, such as log.separator=;"
            )
        set_dotted_key_in_content(content, key, MachineError)
    return find_time_axis_of_section(
        validate_toml_content(Path("--set log"), content["log"], LogSection, MachineError)
    )


def make_key_owner_prompt_or_none() -> "Callable[[SignedBy], str] | None":
    """Return the function that asks the user about an unknown key; None without a terminal."""
    at_terminal = sys.stdin.isatty() and sys.stderr.isatty()
    return prompt_for_key_owner if at_terminal else None


def prompt_for_key_owner(signature: "SignedBy") -> str:
    """Ask for the owner of a key; "" if the key is not trusted."""
    from estimators.errors import join_to_one_line

    typer.echo(f"This evidence is {join_to_one_line(str(signature))}.", err=True)
    typer.echo(f"SHA-256 of the key: {signature.key_id}", err=True)
    typer.echo(
        "Compare it with the one that the signer gave you through another channel.", err=True
    )
    return typer.prompt(
        "Who owns this key? (a name stores the key, an empty answer rejects it)",
        default="",
        show_default=False,
        err=True,
    )
