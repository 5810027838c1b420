"""Former names of keys in TOML files: still read, and rewritten by `payscope migrate`."""

import tomllib
from collections.abc import Iterator, Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, NamedTuple

from estimators.errors import MachineError
from recordings.report.atomic_output import stage_output_file

#: Present name of a key by its former name, both dotted, for all TOML files of payscope.
OLD_NAMES: Final[Mapping[str, str]] = {
    "settings.rate_hz": "settings.align.rate_hz",
    "settings.gap_periods": "settings.align.gap_periods",
    "settings.smooth_samples": "settings.smooth.samples",
    "settings.derivative_cutoff_hz": "settings.filter.cutoff_hz",
    "settings.causal": "settings.filter.causal",
    "settings.acceleration": "settings.forces.acceleration",
    "settings.coulomb": "settings.forces.coulomb",
    "settings.direction_deadband_m_s": "settings.forces.direction_deadband_m_s",
    "settings.speed_rate_span_s": "settings.phases.speed_rate_span_s",
    "settings.standstill_speed_m_s": "settings.phases.standstill_speed_m_s",
    "settings.steady_acc_m_s2": "settings.phases.steady_acc_m_s2",
    "settings.turning_rate_rad_s": "settings.phases.turning_rate_rad_s",
    "settings.steady_yaw_acc_rad_s2": "settings.phases.steady_yaw_acc_rad_s2",
    "settings.window_samples": "settings.gate.window_samples",
    "settings.gate": "settings.gate.index",
    "settings.threshold_nat": "settings.gate.threshold_nat",
    "settings.threshold_std_kg": "settings.gate.threshold_std_kg",
    "settings.threshold_std_kg_m2": "settings.gate.threshold_std_kg_m2",
    "settings.ksg_neighbours": "settings.gate.ksg_neighbours",
    "settings.exclude_braking": "settings.gate.exclude_braking",
    "settings.saturation_force_N": "settings.gate.saturation_force_N",
    "settings.saturation_torque_z_N_m": "settings.gate.saturation_torque_z_N_m",
    "settings.slip_acc_m_s2": "settings.gate.slip_acc_m_s2",
    "settings.condition_max": "settings.gate.condition_max",
    "settings.methods": "settings.trace.methods",
    "settings.forgetting": "settings.trace.forgetting",
    "settings.directional_forgetting": "settings.trace.directional_forgetting",
    "settings.fgls_floor": "settings.trace.fgls_floor",
    "settings.huber_bend": "settings.trace.huber_bend",
    "settings.tls_noise_force_N": "settings.noise.force_N",
    "settings.tls_noise_acc_m_s2": "settings.noise.acc_m_s2",
    "settings.tls_noise_speed_m_s": "settings.noise.speed_m_s",
    "settings.tls_noise_torque_z_N_m": "settings.noise.torque_z_N_m",
    "settings.tls_noise_yaw_acc_rad_s2": "settings.noise.yaw_acc_rad_s2",
    "settings.tls_noise_yaw_rate_rad_s": "settings.noise.yaw_rate_rad_s",
    "settings.threshold_std_com_m": "settings.planar.threshold_std_com_m",
}
#: Most old names that a message lists; further ones are counted.
_MOST_NAMED: Final = 3


class OldNameWarning(UserWarning):
    """Warning that a file uses former names of keys, which were read."""


class OldKeyError(ValueError):
    """Raised if a former key cannot be renamed to its present name."""


def rename_old_keys_in_content(file_content: dict[str, Any]) -> dict[str, str]:
    """Rename former keys to their present names.

    Args:
        file_content: content of the file; changed in place.

    Returns:
        Present name by former name.

    Raises:
        OldKeyError: the new name exists as well, or a value is in its place.
    """
    taken: list[tuple[str, str, Any]] = []
    for old, new in OLD_NAMES.items():
        *sections, name = old.split(".")
        table = _find_table_of_content(file_content, sections)
        # a key that has become a section is the old one if it has a value
        if table is not None and not isinstance(table.get(name, {}), dict):
            taken.append((old, new, table.pop(name)))
    for old, new, value in taken:
        *sections, name = new.split(".")
        place: Any = file_content
        for section in sections:
            place = place.setdefault(section, {})
            if not isinstance(place, dict):
                raise OldKeyError(
                    f"'{old}' is now '{new}', but '{section}' already has a value and cannot be a "
                    f"table; rename or remove '{section}'"
                )
        if name in place:
            raise OldKeyError(
                f"'{old}' is the old name of '{new}', and both are given; remove the old one"
            )
        place[name] = value
    return {old: new for old, new, _ in taken}


def describe_renamed_keys_in_line(new_names: Mapping[str, str]) -> str:
    """Say in one line which keys have new names."""
    pairs = [f"'{old}' is now '{new}'" for old, new in new_names.items()]
    more = len(pairs) - _MOST_NAMED
    return ", ".join(pairs[:_MOST_NAMED]) + (f" (and {more} more)" if more > 0 else "")


class MigratedText(NamedTuple):
    """Text of a TOML file with present keys, and the new name of each old key."""

    text: str
    new_name_by_old: dict[str, str]


def migrate_toml_text(toml_text: str) -> MigratedText:
    """Replace former keys in the text of a TOML file; comments and order are kept.

    A key stays where it is, as `align.rate_hz` in `[settings]`. If the file has the table
    `[settings.align]`, the key moves there, together with the comment lines directly above it.

    Returns:
        The text, and present names by former name.

    Raises:
        OldKeyError: as from `rename_old_keys_in_content`; also if a key is written such that only a
            person can rename it, as in an inline table.
        ValueError: the text is not TOML.
    """
    wanted = tomllib.loads(toml_text)
    renamed = rename_old_keys_in_content(wanted)
    lines = toml_text.splitlines(keepends=True)
    for old, new in renamed.items():
        rename_key_in_lines(lines, old, new)
    migrated = "".join(lines)
    try:
        is_equal = tomllib.loads(migrated) == wanted
    except tomllib.TOMLDecodeError:
        is_equal = False
    if not is_equal:
        raise OldKeyError(
            f"{describe_renamed_keys_in_line(renamed)}: cannot be rewritten; rename it by hand"
        )
    return MigratedText(migrated, renamed)


def migrate_toml_file(path: Path) -> dict[str, str]:
    """Rewrite a TOML file with present key names; comments and order are kept.

    Returns:
        Present name by former name; if empty, the file is unchanged.

    Raises:
        MachineError: it cannot be read, is not TOML, or a person has to rename a key.
        OutputError: it cannot be written.
    """
    try:
        # read as bytes, so that line ends are kept
        text, renamed = migrate_toml_text(path.read_bytes().decode("utf-8"))
    except OSError as fault:
        raise MachineError(f"{path}: cannot be read ({fault.strerror})") from None
    except UnicodeDecodeError:
        raise MachineError(f"{path}: is not UTF-8; save it as UTF-8") from None
    except OldKeyError as fault:
        raise MachineError(f"{path}: {fault}") from None
    except ValueError as fault:
        raise MachineError(f"{path}: is not TOML: {fault}") from None
    if renamed:
        target = path.resolve()  # a link remains a link
        mode = target.stat().st_mode
        with stage_output_file(target, overwrites=True) as partial:
            partial.write_bytes(text.encode("utf-8"))
            partial.chmod(mode)
    return renamed


def _find_table_of_content(content: dict[str, Any], sections: list[str]) -> dict[str, Any] | None:
    here: Any = content
    for section in sections:
        here = here.get(section) if isinstance(here, dict) else None
    return here if isinstance(here, dict) else None


def rename_key_in_lines(lines: list[str], old_key: str, new_key: str) -> None:
    """Rename a key in lines, or move it to the table of its new name; nothing if it is absent."""
    tables = list(_iter_tables_of_lines(lines))
    for table in tables:
        for at in range(table.first, table.last):
            key, equals, value = lines[at].partition("=")
            if not equals or f"{table.prefix}{unquote_dotted_key(key)}" != old_key:
                continue
            home = max(
                (t for t in tables if new_key.startswith(t.prefix)), key=lambda t: len(t.prefix)
            )
            lines[at] = f"{key.replace(key.strip(), new_key.removeprefix(home.prefix))}={value}"
            if home is not table:
                _move_key_to_other_table(lines, at, table, home)
            return


def _move_key_to_other_table(
    lines: list[str], line_index: int, old_table: "_TableLines", new_table: "_TableLines"
) -> None:
    """Move a key, with the comment lines directly above it, to the top of another table."""
    end = _find_line_after_value(lines, line_index, old_table.last)
    while line_index > old_table.first and lines[line_index - 1].lstrip().startswith("#"):
        line_index -= 1
    moved = lines[line_index:end]
    if not moved[-1].endswith("\n"):
        moved[-1] += "\n"
    del lines[line_index:end]
    to = new_table.first - (len(moved) if new_table.first > line_index else 0)
    lines[to:to] = moved


class _TableLines(NamedTuple):
    """Lines of a table's keys, and the table's dotted name followed by a dot."""

    prefix: str
    first: int
    last: int


def _iter_tables_of_lines(lines: list[str]) -> Iterator[_TableLines]:
    heads = [
        at
        for at, line in enumerate(lines)
        if line.lstrip()[:1] == "[" and is_table_header_line(line)
    ]
    yield _TableLines("", 0, heads[0] if heads else len(lines))
    for at, end in pairwise([*heads, len(lines)]):
        name = lines[at].partition("]")[0].strip().strip("[")
        yield _TableLines(f"{unquote_dotted_key(name)}.", at + 1, end)


def is_table_header_line(line: str) -> bool:
    """Whether a line that begins with a bracket is a table header, not part of nested lists."""
    try:
        return bool(tomllib.loads(line))
    except tomllib.TOMLDecodeError:
        return False


def _find_line_after_value(lines: list[str], line_index: int, last_line: int) -> int:
    """Index of the line after a value, which may span several lines."""
    for end in range(line_index + 1, last_line + 1):
        try:
            tomllib.loads("".join(lines[line_index:end]))
        except tomllib.TOMLDecodeError:
            continue
        return end
    return line_index + 1


def unquote_dotted_key(quoted_key: str) -> str:
    """Remove quotes and blanks from a dotted key."""
    return ".".join(part.strip().strip("\"'") for part in quoted_key.split("."))
