"""Read and validate campaign files (TOML); every error is one line."""

import hashlib
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final, NamedTuple

from analysis.calibration.campaign.campaign_fit import (
    make_decision_rule,
    tabulate_reference_masses_and_covariance,
)
from analysis.calibration.campaign.campaign_plan import CalibrationCampaign
from analysis.model.machine import Machine
from estimators.errors import CampaignError, DataError, EvidenceError
from recordings.dcc.dcc_limits import LIMITS as DCC_LIMITS
from replay.machines.machine_file import find_machine_file_or_shipped_one, load_machine
from replay.machines.toml_file import (
    read_toml_file,
    refuse_other_kind_of_file,
    validate_toml_content,
)

#: Keys that are read from a certificate, and must not be given beside it.
_READ: Final = ("value_kg", "u_kg", "certificate", "certificate_sha256", "certificate_issuer")
#: Placeholder of a draft for what no log contains; does not match a name such as TODOROV.
_TODO: Final = re.compile(r"TODO\b")


class CampaignAndMachine(NamedTuple):
    """A campaign, and the machine that it calibrates."""

    campaign: CalibrationCampaign
    machine: Machine


def load_campaign_and_machine(path: Path) -> CampaignAndMachine:
    """Read a campaign file and the machine file that it names.

    Args:
        path: TOML file; paths in it are relative to its folder.

    Raises:
        CampaignError: one line with the file, the fault, the choices and the remedy; also if a
            certificate had expired on the day of a run, or a log is missing.
        MachineError: the same for the machine file.
    """
    if not path.exists():
        raise CampaignError(
            f"{path}: no such campaign file; `payscope init --campaign FOLDER -o {path}` drafts "
            "one from a folder of logs"
        )
    content = read_toml_file(path, CampaignError)
    refuse_other_kind_of_file(path, content, "campaign file", CampaignError)
    for place, text in iter_unfilled_draft_entries(content):
        raise CampaignError(f"{path}: {place}: is not filled in yet ('{text}')")
    content = fill_in_masses_of_certificates(path, content)
    campaign = validate_toml_content(path, content, CalibrationCampaign, CampaignError)
    if campaign.laboratory is not None and campaign.missing_certificate_entries:
        raise CampaignError(
            f"{path}: [laboratory] makes this a certificate by ISO/IEC 17025, 7.8, which also "
            f"needs {', '.join(campaign.missing_certificate_entries)}; add them, or leave out "
            "[laboratory]"
        )
    beside = path.parent / campaign.machine.file
    shipped = find_machine_file_or_shipped_one(Path(campaign.machine.file))
    machine = load_machine(beside if beside.exists() or not shipped.exists() else shipped)
    machine = copy_machine_with_serial_number(
        copy_machine_with_campaign_empty_mass(campaign, machine), campaign.machine.id, path
    )
    try:
        known, _ = tabulate_reference_masses_and_covariance(campaign, machine.machine)
        make_decision_rule(campaign, known)
    except (CampaignError, DataError) as fault:
        raise CampaignError(f"{path}: {fault}") from None
    overdue = campaign.describe_invalid_certificates()
    if overdue:
        more = f" (and {len(overdue) - 1} more)" if len(overdue) > 1 else ""
        raise CampaignError(
            f"{path}: {overdue[0]}{more}; give a valid certificate, or leave the mass out"
        )
    for log in campaign.log_names:
        if not (path.parent / log).exists():
            raise CampaignError(
                f"{path}: no log '{log}' in {path.parent}; paths of logs are relative to the "
                "campaign file"
            )
    return CampaignAndMachine(campaign, machine)


def copy_machine_with_serial_number(
    machine: Machine, serial_number: str, source_file: object
) -> Machine:
    """Copy the machine with the given serial number.

    Args:
        machine: machine as read from its file.
        serial_number: serial number of the machine.
        source_file: file that gives the serial number, for the error message.

    Raises:
        CampaignError: the machine file is that of another machine.
    """
    named = machine.machine.id
    if named not in (None, serial_number):
        raise CampaignError(
            f"{source_file}: is for machine '{serial_number}', but its machine file is for "
            f"'{named}'; give the machine file of '{serial_number}', or correct machine.id"
        )
    return machine.model_copy(
        update={"machine": machine.machine.model_copy(update={"id": serial_number})}
    )


class DraftEntry(NamedTuple):
    """Entry of a draft that still begins with TODO."""

    path: str
    text: str


def iter_unfilled_draft_entries(content: Any, path_prefix: str = "") -> Iterator[DraftEntry]:
    """Yield the entries of a draft whose text still begins with TODO, with their paths."""
    if isinstance(content, dict):
        for name, value in content.items():
            yield from iter_unfilled_draft_entries(
                value, f"{path_prefix}.{name}" if path_prefix else name
            )
    elif isinstance(content, list):
        for number, value in enumerate(content, start=1):
            yield from iter_unfilled_draft_entries(value, f"{path_prefix}[{number}]")
    elif isinstance(content, str) and _TODO.match(content):
        yield DraftEntry(path_prefix, content)


def copy_machine_with_campaign_empty_mass(
    campaign: CalibrationCampaign, machine: Machine
) -> Machine:
    """Copy the machine with the empty mass of the campaign file, if it gives one."""
    about = campaign.machine
    given = {"empty_mass_kg": about.empty_mass_kg, "empty_mass_u_kg": about.empty_mass_u_kg}
    known = {name: value for name, value in given.items() if value is not None}
    body = machine.machine.model_copy(update=known)
    return machine.model_copy(update={"machine": body})


def fill_in_masses_of_certificates(
    campaign_path: Path, campaign_content: dict[str, Any]
) -> dict[str, Any]:
    """Fill in the masses that a campaign file takes from digital certificates.

    `masses = "cert.xml#item"` (or a list) takes all data of a mass from the certificate; a block
    `[[masses]]` with `dcc = "cert.xml#item"` may add id, last day and shared part.

    Args:
        campaign_path: campaign file; paths of certificates are relative to its folder.
        campaign_content: content of the campaign file.

    Raises:
        CampaignError: a certificate cannot be read, or a block repeats data of its certificate.
    """
    masses = campaign_content.get("masses", [])
    blocks = [masses] if isinstance(masses, str) else masses
    if not isinstance(blocks, list):
        return campaign_content
    found: list[Any] = []
    keys: list[str] | None = None
    for block in blocks:
        block = {"dcc": block} if isinstance(block, str) else block
        if isinstance(block, dict) and "certificate_signature" in block:
            raise CampaignError(
                f"{campaign_path}: masses: certificate_signature is written by payscope; leave it "
                "out"
            )
        if not isinstance(block, dict) or not isinstance(block.get("dcc"), str):
            found.append(block)
            continue
        keys = (
            _read_trusted_certificate_key_ids(campaign_path, campaign_content)
            if keys is None
            else keys
        )
        found += _read_masses_of_certificate(campaign_path, block, keys)
    return campaign_content if keys is None else {**campaign_content, "masses": found}


def _read_trusted_certificate_key_ids(
    campaign_path: Path, campaign_content: dict[str, Any]
) -> list[str]:
    """Read the ids of the keys that the campaign file trusts for certificates."""
    from recordings.dcc.dcc_signature import read_key_id_from_pem_file

    named = campaign_content.get("dcc_keys", [])
    if not isinstance(named, list) or not all(isinstance(each, str) for each in named):
        raise CampaignError(f"{campaign_path}: dcc_keys: must be a list of PEM key files")
    try:
        return [read_key_id_from_pem_file(campaign_path.parent / each) for each in named]
    except EvidenceError as fault:
        raise CampaignError(f"{campaign_path}: dcc_keys: {fault}") from None


def _read_masses_of_certificate(
    campaign_path: Path, masses_table: dict[str, Any], trusted_key_ids: list[str]
) -> list[dict[str, Any]]:
    """Read the masses of one [[masses]] table that names a digital certificate."""
    from recordings.dcc.dcc_document import parse_untrusted_dcc
    from recordings.dcc.dcc_masses import read_certified_masses
    from recordings.dcc.dcc_signature import check_dcc_signature

    stated = [name for name in _READ if name in masses_table]
    if stated:
        raise CampaignError(
            f"{campaign_path}: masses: {', '.join(stated)} of '{masses_table['dcc']}' is read from "
            "the "
            "certificate; leave it out, or leave dcc out"
        )
    name, _, item = masses_table["dcc"].partition("#")
    path = campaign_path.parent / name
    try:
        with path.open("rb") as file:
            data = file.read(DCC_LIMITS.certificate_bytes + 1)
        signed = check_dcc_signature(parse_untrusted_dcc(data, str(path)), str(path))
        masses = read_certified_masses(signed.root, item, str(path))
    except OSError as error:
        raise CampaignError(f"{path}: cannot be read ({error.strerror})") from None
    except EvidenceError as fault:
        raise CampaignError(str(fault)) from None
    if len(masses) > 1 and "id" in masses_table:
        raise CampaignError(
            f"{path}: has {len(masses)} items, but '{masses_table['id']}' names a single mass; "
            "leave out "
            "its id"
        )
    return [
        {
            "id": re.sub(r"[^A-Za-z0-9._-]", "-", mass.item_id).lstrip("._-")[:64],
            **masses_table,
            "dcc": f"{name}#{mass.item_id}",
            "value_kg": mass.value_kg,
            "u_kg": mass.u_kg,
            "certificate": mass.certificate[:200],
            "certificate_issuer": mass.issuer[:200],
            "certificate_sha256": hashlib.sha256(data).hexdigest(),
            "certificate_signature": signed.describe_signature(trusted_key_ids),
        }
        for mass in masses
    ]
