"""Common behaviour of all commands: help that names values, and outputs that replace no input.

Typer would print the Python type of every value (`<list[Path]>`), and `<bool>` for an option that
has none. A command that would overwrite one of its inputs is refused before it begins.
"""

import inspect
from collections.abc import Iterator, Mapping
from datetime import datetime
from math import isfinite
from pathlib import Path
from pickle import UnpicklingError
from typing import Any, Final, get_args

import typer
from typer.core import TyperArgument, TyperCommand, TyperGroup

from estimators.errors import PayscopeError

#: Name of a value in the help, by its type.
_VALUE_NAMES: Final = {Path: "PATH", str: "TEXT", int: "N", float: "X", datetime: "TIME"}
#: Parameters with outputs of a command; every other one may be an input.
_OUTPUTS: Final = frozenset({"output", "figure", "reports", "timestamp_request", "dcc"})


class PayscopeCommand(TyperCommand):
    """A command whose help names values, not types, and whose outputs must not be its inputs."""

    def invoke(self, ctx: Any) -> Any:
        """Run the command; raise an error if an output is an input, or a number is not finite."""
        parameters: list[Any] = self.params
        for parameter in parameters:
            value = ctx.params.get(parameter.name)
            if isinstance(value, float) and not isfinite(value):
                what = f"input should be a finite number, not {value:g}"
                raise typer.BadParameter(what, ctx=ctx, param=parameter)
        refuse_outputs_among_inputs(ctx.params)
        try:
            return super().invoke(ctx)
        except (UnpicklingError, EOFError) as error:
            raise remove_compiled_code_and_make_error(error) from error

    def get_params(self, ctx: Any) -> list[Any]:
        """Parameters, with names for their values."""
        return [name_value_of_parameter(each) for each in super().get_params(ctx)]

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Usage without braces around required parameters, and with at most three dots."""
        pieces = [piece.translate(_BRACES) for piece in super().collect_usage_pieces(ctx)]
        return [each.removesuffix("...") if "..." in each[:-3] else each for each in pieces]


class PayscopeCommandGroup(TyperGroup):
    """A group of commands whose help names the values of its options."""

    def get_params(self, ctx: Any) -> list[Any]:
        """The parameters, with names for their values."""
        return [name_value_of_parameter(each) for each in super().get_params(ctx)]


def remove_compiled_code_and_make_error(error: Exception) -> Exception:
    """Remove compiled code that could not be read, and make the error that says so.

    Typer would exit after an EOFError without saying anything.
    """
    from estimators.compile_cache import remove_unreadable_compiled_code

    removed = ", ".join(map(str, remove_unreadable_compiled_code(error)))
    if not removed:
        return RuntimeError(f"{type(error).__name__}: {error}")
    return PayscopeError(
        f"{removed}: compiled code kept there cannot be read and was removed; run it again"
    )


_BRACES: Final = str.maketrans("", "", "{}")


def name_value_of_parameter(parameter: Any) -> Any:
    """Name the value of a parameter in its help, unless its declaration does, or it is a flag."""
    if isinstance(parameter, TyperArgument):
        if parameter.metavar is None:
            is_many = parameter.nargs != 1
            parameter.metavar = (parameter.name.removesuffix("s" * is_many)).upper()
        # the name is sufficient
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


def refuse_outputs_among_inputs(parameters: Mapping[str, Any]) -> None:
    """Raise an error if an output of a command would replace a path in its other parameters.

    Raises:
        OutputError: an output is such a path, under any name or link, and even with `--force`.
    """
    outputs = [
        path
        for name in sorted(_OUTPUTS & parameters.keys())
        for path in _iter_existing_paths(parameters[name])
    ]
    if not outputs:
        return
    from recordings.report.atomic_output import refuse_input_as_output

    inputs = [
        path
        for name, value in parameters.items()
        if name not in _OUTPUTS
        for path in _iter_existing_paths(value)
    ]
    for output in outputs:
        refuse_input_as_output(output, inputs)


def _iter_existing_paths(value: Any) -> Iterator[Path]:
    if isinstance(value, list | tuple):
        for each in value:
            yield from _iter_existing_paths(each)
    elif isinstance(value, str | Path) and _is_existing_path(Path(value)):
        yield Path(value)


def _is_existing_path(path: Path) -> bool:
    try:
        return path.exists()
    except OSError:  # a text that is not a path, such as a long SQL statement
        return False


def _show_nothing(ctx: Any) -> None:
    del ctx


def write_help_as_users_read_it(commands: typer.Typer) -> None:
    """Join the lines of each paragraph of the help, which the terminal wraps, and name values."""
    commands.info.cls = PayscopeCommandGroup
    for each in commands.registered_commands:
        paragraphs = (inspect.getdoc(each.callback) or "").split("\n\n")
        each.help = "\n\n".join(" ".join(paragraph.split()) for paragraph in paragraphs)
        each.cls = PayscopeCommand
