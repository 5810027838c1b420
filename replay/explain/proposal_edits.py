"""Write proposals into a machine file, keeping comments and order."""

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from analysis.explain import Finding
from estimators.errors import MachineError, join_to_one_line
from recordings.report.finding_text import describe_mass_change_if_fixed, find_readable_cause_name
from replay.machines.old_names import OldKeyError, migrate_toml_text


@dataclass(frozen=True, slots=True)
class Proposal:
    """A key of the machine file and its proposed value.

    Attributes:
        key: dotted key.
        value: value as TOML.
        cause: cause of the finding that proposes it.
        comment: reason, in one line.
        change_kg: change of the mass in kg; None if unknown, or stated with another key.
        change_u_kg: standard uncertainty of that change in kg; None if `change_kg` is.
    """

    key: str
    value: Any
    cause: str
    comment: str
    change_kg: float | None = None
    change_u_kg: float | None = None


def make_proposal_for_each_key_of_finding(finding: Finding) -> tuple[Proposal, ...]:
    """Proposals of a finding, one per key; empty if there are none."""
    if not finding.has_proposal:
        return ()
    keys = [key.strip() for key in str(finding.setting).split(",")]
    values = parse_comma_separated_toml(str(finding.value))
    if len(keys) != len(values):
        return ()
    said = "; ".join(
        filter(
            None,
            (
                find_readable_cause_name(finding.cause),
                finding.evidence,
                describe_mass_change_if_fixed(finding),
            ),
        )
    )
    return tuple(
        Proposal(
            key,
            value,
            finding.cause,
            join_to_one_line(said),
            None if number else finding.mass_change_kg,
            None if number else finding.mass_change_u_kg,
        )
        for number, (key, value) in enumerate(zip(keys, values, strict=True))
    )


def parse_comma_separated_toml(text: str) -> list[Any]:
    """Parse comma-separated TOML values; empty if they are invalid."""
    try:
        return tomllib.loads(f"values = [{text}]")["values"]
    except ValueError:
        return []


def insert_proposals_into_machine_file(
    machine_text: str, changes: Sequence[Proposal], machine_path: Path
) -> str:
    """Insert proposals into a machine file, each with a comment after the user's own.

    Old names of keys are replaced first, so that no proposal duplicates an old name.

    Args:
        machine_text: text of the machine file.
        changes: the proposals.
        machine_path: path of the file, for error messages.

    Raises:
        MachineError: the text is not TOML, a parent of a key is a value instead of a table, or an
            old name cannot be replaced without a decision of the user.
    """
    import tomlkit
    from tomlkit.container import OutOfOrderTableProxy
    from tomlkit.exceptions import TOMLKitError
    from tomlkit.items import InlineTable, Table

    try:
        document = tomlkit.parse(migrate_toml_text(machine_text)[0])
        for change in changes:
            *sections, name = change.key.split(".")
            place: Any = document
            for section in sections:
                if section not in place:
                    place[section] = tomlkit.table()
                place = place[section]
                if not isinstance(place, Table | InlineTable | OutOfOrderTableProxy):
                    raise MachineError(
                        f"{machine_path}: '{section}' of {change.key} is not a table; make it a "
                        "table, or apply the proposal by hand"
                    )
            new = tomlkit.item(change.value)
            # TOML allows no comment in an inline table
            if not isinstance(place, InlineTable):
                new.comment(_format_change_comment(place, name, change.comment))
            place[name] = new
        return tomlkit.dumps(document)
    except OldKeyError as error:
        raise MachineError(f"{machine_path}: {error}") from None
    except (TOMLKitError, tomllib.TOMLDecodeError) as error:
        raise MachineError(f"{machine_path}: is not TOML: {join_to_one_line(str(error))}") from None


def _format_change_comment(table: Any, key_name: str, reason: str) -> str:
    """Format the comment of a changed key: the user's comment, the reason, and the old value."""
    import tomlkit
    from tomlkit.items import Table

    if key_name not in table:
        return f"payscope: {reason}"
    # indexing a table gives a boolean as a plain bool, without its comment
    was: Any = (
        table.value.item(key_name) if isinstance(table, Table) else tomlkit.item(table[key_name])
    )
    theirs = was.trivia.comment.lstrip("# ")
    return "; ".join(filter(None, (theirs, f"payscope: {reason}; it was {was.as_string()}")))
