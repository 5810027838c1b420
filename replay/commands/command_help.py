"""Help of the commands: paragraphs as wide as the terminal, values named as other tools name them.

Typer prints the Python type of every value (`<list[Path]>`), and `<bool>` where an option takes
none.
"""

import inspect
from datetime import datetime
from pathlib import Path
from typing import Any, Final, get_args

import typer
from typer.core import TyperArgument, TyperCommand, TyperGroup

#: What a value of a type is called.
_VALUE_NAMES: Final = {Path: "PATH", str: "TEXT", int: "N", float: "X", datetime: "TIME"}


class PayscopeCommand(TyperCommand):
    """A command whose help names values, not types."""

    def get_params(self, ctx: Any) -> list[Any]:
        """The parameters, with names for their values."""
        return [name_value_of_parameter(each) for each in super().get_params(ctx)]

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Usage without the braces around what is required, and with three dots at most."""
        pieces = [piece.translate(_BRACES) for piece in super().collect_usage_pieces(ctx)]
        return [each.removesuffix("...") if "..." in each[:-3] else each for each in pieces]


class PayscopeCommandGroup(TyperGroup):
    """A group of commands whose own options are named likewise."""

    def get_params(self, ctx: Any) -> list[Any]:
        """The parameters, with names for their values."""
        return [name_value_of_parameter(each) for each in super().get_params(ctx)]


_BRACES: Final = str.maketrans("", "", "{}")


def name_value_of_parameter(parameter: Any) -> Any:
    """Name the value of a parameter in its help, unless its declaration does; nothing of a flag."""
    if isinstance(parameter, TyperArgument):
        if parameter.metavar is None:
            is_many = parameter.nargs != 1
            parameter.metavar = (parameter.name.removesuffix("s" * is_many)).upper()
        # the name says what it is
        parameter.display_type_rich = _show_nothing  # type: ignore[method-assign]
    elif parameter.metavar is None:
        kind = parameter.type_descriptor
        if parameter.is_flag or parameter.count:
            parameter.metavar = ""
            parameter.show_default = bool(parameter.default)
        elif not kind.is_choice:
            types = get_args(kind.annotation) or (kind.annotation,)
            parameter.metavar = _VALUE_NAMES.get(types[0])
    return parameter


def _show_nothing(ctx: Any) -> None:
    del ctx


def write_help_as_users_read_it(commands: typer.Typer) -> None:
    """Join the lines of each paragraph, which the terminal wraps, and name the values."""
    commands.info.cls = PayscopeCommandGroup
    for each in commands.registered_commands:
        paragraphs = (inspect.getdoc(each.callback) or "").split("\n\n")
        each.help = "\n\n".join(" ".join(paragraph.split()) for paragraph in paragraphs)
        each.cls = PayscopeCommand
