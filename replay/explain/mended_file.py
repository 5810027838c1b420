"""A machine file with proposals in it: comments and order stay, each change says why."""

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from analysis.explain import Finding
from estimators.errors import MachineError, one_line
from recordings.report.finding_text import cause_name, mass_change_text
from replay.machines.old_names import BothNamesError, migrate_text


@dataclass(frozen=True, slots=True)
class Proposal:
    """A key of the machine file, and the value that a finding proposes for it.

    Attributes:
        key: dotted.
        value: as TOML has it.
        cause: of the finding.
        comment: why, in a line.
        change_kg: what it would do to the mass; None where that is not known, or said elsewhere.
        change_u_kg: standard uncertainty of that.
    """

    key: str
    value: Any
    cause: str
    comment: str
    change_kg: float | None = None
    change_u_kg: float | None = None


def proposals_of_finding(finding: Finding) -> tuple[Proposal, ...]:
    """Proposals of a finding, a key each; none if there is nothing to write."""
    if not finding.has_proposal:
        return ()
    keys = [key.strip() for key in str(finding.setting).split(",")]
    values = _parse_toml_values(str(finding.value))
    if len(keys) != len(values):
        return ()
    said = "; ".join(
        filter(None, (cause_name(finding.cause), finding.evidence, mass_change_text(finding)))
    )
    return tuple(
        Proposal(
            key,
            value,
            finding.cause,
            one_line(said),
            None if number else finding.mass_change_kg,
            None if number else finding.mass_change_u_kg,
        )
        for number, (key, value) in enumerate(zip(keys, values, strict=True))
    )


def _parse_toml_values(text: str) -> list[Any]:
    """Values by commas, each as TOML; none where they are not."""
    try:
        return tomllib.loads(f"values = [{text}]")["values"]
    except ValueError:
        return []


def write_proposals(text: str, changes: Sequence[Proposal], path: Path) -> str:
    """Write changes into the text of a machine file, each with a comment behind the user's own.

    Keys with old names get those that they have now, lest a change meet its own old name.

    Args:
        text: the file.
        changes: the proposals.
        path: of the file, for messages.

    Raises:
        MachineError: it is no TOML, a key leads through a value, or a person has to rename one.
    """
    import tomlkit
    from tomlkit.container import OutOfOrderTableProxy
    from tomlkit.exceptions import TOMLKitError
    from tomlkit.items import InlineTable, Table

    try:
        document = tomlkit.parse(migrate_text(text)[0])
        for change in changes:
            *sections, name = change.key.split(".")
            place: Any = document
            for section in sections:
                if section not in place:
                    place[section] = tomlkit.table()
                place = place[section]
                if not isinstance(place, Table | InlineTable | OutOfOrderTableProxy):
                    raise MachineError(f"{path}: '{section}' of {change.key} is not a table")
            new = tomlkit.item(change.value)
            # within braces, TOML has no comments
            if not isinstance(place, InlineTable):
                new.comment(_change_comment(place, name, change.comment))
            place[name] = new
        return tomlkit.dumps(document)
    except BothNamesError as error:
        raise MachineError(f"{path}: {error}") from None
    except (TOMLKitError, tomllib.TOMLDecodeError) as error:
        raise MachineError(f"{path}: is not TOML: {one_line(str(error))}") from None


def _change_comment(place: Any, name: str, why: str) -> str:
    """Comment behind a key: the user's words, why it changed, and its old value."""
    import tomlkit
    from tomlkit.items import Table

    if name not in place:
        return f"payscope: {why}"
    # a boolean would come out of a table as it is, without its comment
    was: Any = place.value.item(name) if isinstance(place, Table) else tomlkit.item(place[name])
    theirs = was.trivia.comment.lstrip("# ")
    return "; ".join(filter(None, (theirs, f"payscope: {why}; it was {was.as_string()}")))
