"""Reference masses of a campaign file that stand in digital certificates."""

import hashlib
import re
from pathlib import Path
from typing import Any, Final

from estimators.errors import CampaignError, EvidenceError

#: What is read of a certificate and is not to be stated beside it.
_READ: Final = ("value_kg", "u_kg", "certificate", "certificate_sha256", "certificate_issuer")


def with_certified_masses(source: Path, content: dict[str, Any]) -> dict[str, Any]:
    """The content of a campaign file with the masses that it takes from certificates.

    `masses = "cert.xml#item"` (or a list of such) takes all of a mass from there; a block
    `[[masses]]` with `dcc = "cert.xml#item"` may add its id, last day and shared part.

    Args:
        source: the campaign file; certificates are named from its folder.
        content: of it.

    Raises:
        CampaignError: a certificate cannot be read, or a block states what its certificate has.
    """
    masses = content.get("masses", [])
    blocks = [masses] if isinstance(masses, str) else masses
    if not isinstance(blocks, list):
        return content
    found: list[Any] = []
    keys: list[str] | None = None
    for block in blocks:
        block = {"dcc": block} if isinstance(block, str) else block
        if isinstance(block, dict) and "certificate_signature" in block:
            raise CampaignError(
                f"{source}: masses: certificate_signature is written by payscope; leave it out"
            )
        if not isinstance(block, dict) or not isinstance(block.get("dcc"), str):
            found.append(block)
            continue
        keys = _keys(source, content) if keys is None else keys
        found += _masses_of(source, block, keys)
    return content if keys is None else {**content, "masses": found}


def _keys(source: Path, content: dict[str, Any]) -> list[str]:
    """Ids of the keys that the campaign file trusts."""
    from recordings.dcc.dcc_signature import trusted_key_id

    named = content.get("dcc_keys", [])
    if not isinstance(named, list) or not all(isinstance(each, str) for each in named):
        raise CampaignError(f"{source}: dcc_keys: is a list of files with keys in PEM")
    try:
        return [trusted_key_id(source.parent / each) for each in named]
    except EvidenceError as fault:
        raise CampaignError(f"{source}: dcc_keys: {fault}") from None


def _masses_of(source: Path, block: dict[str, Any], keys: list[str]) -> list[dict[str, Any]]:
    from recordings.dcc.dcc_document import MOST_BYTES, parse_dcc
    from recordings.dcc.dcc_masses import certified_masses
    from recordings.dcc.dcc_signature import check_signature

    stated = [name for name in _READ if name in block]
    if stated:
        raise CampaignError(
            f"{source}: masses: {', '.join(stated)} of '{block['dcc']}' is read from the "
            "certificate; leave it out, or leave dcc out"
        )
    name, _, item = block["dcc"].partition("#")
    path = source.parent / name
    try:
        with path.open("rb") as file:
            data = file.read(MOST_BYTES + 1)
        signed = check_signature(parse_dcc(data, str(path)), str(path))
        masses = certified_masses(signed.root, item, str(path))
    except OSError as error:
        raise CampaignError(f"{path}: cannot be read ({error.strerror})") from None
    except EvidenceError as fault:
        raise CampaignError(str(fault)) from None
    if len(masses) > 1 and "id" in block:
        raise CampaignError(f"{path}: has {len(masses)} items, and '{block['id']}' is one of them")
    return [
        {
            "id": re.sub(r"[^A-Za-z0-9._-]", "-", mass.item_id).lstrip("._-")[:64],
            **block,
            "dcc": f"{name}#{mass.item_id}",
            "value_kg": mass.value_kg,
            "u_kg": mass.u_kg,
            "certificate": mass.certificate[:200],
            "certificate_issuer": mass.issuer[:200],
            "certificate_sha256": hashlib.sha256(data).hexdigest(),
            "certificate_signature": signed.signature(keys),
        }
        for mass in masses
    ]
