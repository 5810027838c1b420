"""The command line: `payscope COMMAND`. Data on stdout, messages on stderr.

Exit status: 0 done; 1 the answer is no (cannot weigh, differs); 2 bad input or usage, with one
line that says which file, what is wrong and what to do. `verify` adds 3 tampered, 4 irreproducible,
5 incomplete, 6 not within limits, 7 expired, 8 made by another version.
"""

import os
import signal
import sys
import warnings
from collections.abc import Generator
from contextlib import contextmanager
from types import FrameType
from typing import Any, Final

import typer

from estimators.errors import PayscopeError, join_to_one_line
from replay.commands import (
    calibrate,
    compare,
    convert,
    demo,
    excite,
    explain,
    fleet,
    follow,
    info,
    init,
    keys,
    migrate,
    notarise,
    plot,
    query,
    reproduce,
    review,
    run,
    show,
    simulate,
    sweep,
    verify,
    view,
    warm_up,
)
from replay.commands.payscope_command import write_help_as_users_read_it

app = typer.Typer(
    name="payscope",
    help="Weigh robotic loaders from their recorded logs, and show every step of the answer.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
#: Commands by purpose, as `payscope --help` groups them.
_PANELS: Final = {
    "Weigh": (init, run, follow, explain, sweep),
    "Look": (info, query, convert, show, plot, view, compare),
    "Shift and fleet": (review,),
    "Calibrate": (calibrate, verify, notarise),
    "Simulate": (demo, simulate, excite, reproduce),
    "Install": (warm_up, migrate),
}
for _panel, _commands in _PANELS.items():
    for _command in _commands:
        _name = _command.__name__.rpartition(".")[2].replace("_", "-")
        app.command(name=_name, rich_help_panel=_panel)(_command.command)
app.add_typer(fleet.app, name="fleet", rich_help_panel="Shift and fleet")
app.add_typer(
    keys.app,
    name="keys",
    help="Keep the public keys of signers that you know.",
    rich_help_panel="Calibrate",
)


for _app in (app, fleet.app, keys.app):
    write_help_as_users_read_it(_app)


@app.callback(invoke_without_command=True)
def _print_version_and_exit(
    is_requested: bool = typer.Option(False, "--version", help="Show the version and exit."),
) -> None:
    if is_requested:
        from importlib.metadata import version as version_of

        from recordings.calibration.page.verifier_page import compute_verifier_page_sha256

        typer.echo(f"payscope {version_of('payscope')}")
        typer.echo(f"verifier page: SHA-256 {compute_verifier_page_sha256()}")
        raise typer.Exit


def main() -> None:
    """Run the command line and exit with its status."""
    reopen_closed_standard_streams()
    received = install_signals_as_exceptions()
    try:
        with _warn_of_old_keys_on_exit():
            status = app(standalone_mode=False)
        sys.stdout.flush()
    except PayscopeError as error:
        status = _print_error_and_get_exit_status(str(error))
    except typer.TyperException as error:
        status = _print_error_and_get_exit_status(format_usage_error(error))
    except (KeyboardInterrupt, typer.Abort):
        status = 130
    except SystemError:  # all that compiled code says of an interrupt
        if not received:
            raise
        status = 128 + received[0]
    except BrokenPipeError:
        _discard_buffered_stdout()
        status = 0
    except SystemExit as leaving:
        # typer and rich exit with 1 if the reader of our output has closed it (`| head`)
        if not isinstance(leaving.__context__, BrokenPipeError):
            raise
        _discard_buffered_stdout()
        status = 0
    except OSError as error:
        _discard_buffered_stdout()
        # a file that was being closed when the signal arrived may have been closed twice
        status = (
            128 + received[0]
            if received
            else _print_error_and_get_exit_status(
                f"{error.filename or 'stdout'}: {error.strerror or error}"
            )
        )
    sys.exit(status or 0)


#: How to provide an option that is missing.
_MISSING: Final = {
    "--machine": "`payscope init LOG -o machine.toml` drafts a machine file",
    "--over": "give a setting and its values, --over settings.gate.threshold_nat=0.5,0.7",
}


def format_usage_error(error: typer.TyperException) -> str:
    """Format the message for a wrong command line; it says how to obtain a missing argument."""
    said = error.format_message() or "see payscope --help"
    if said.startswith("Missing "):
        path = getattr(getattr(error, "ctx", None), "command_path", "payscope")
        help_of = f"`{path} --help` lists what it takes"
        remedy = next((text for option, text in _MISSING.items() if option in said), help_of)
        return f"{said.rstrip('.')}; {remedy}"
    # phrases of the libraries that name Python's errors
    said = said.removeprefix("Invalid value: ").replace("Value error, ", "")
    return said.replace(": Input should", ": input should")


def reopen_closed_standard_streams() -> None:
    """Reopen closed standard streams (`>&-`), so that no file gets their descriptors."""
    for name, flag, mode in (
        ("stdin", os.O_RDONLY, "r"),
        ("stdout", os.O_WRONLY, "w"),
        ("stderr", os.O_WRONLY, "w"),
    ):
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(os.open(os.devnull, flag), mode, encoding="utf-8"))


def install_signals_as_exceptions() -> list[int]:
    """Turn signals into exceptions, so that partial outputs are removed on exit.

    Returns:
        Numbers of the signals received so far.
    """
    received: list[int] = []

    def raise_for_signal(signal_number: int, _frame: FrameType | None) -> None:
        received.append(signal_number)
        if signal_number == signal.SIGINT:
            raise KeyboardInterrupt
        raise SystemExit(128 + signal_number)

    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, raise_for_signal)
    return received


@contextmanager
def _warn_of_old_keys_on_exit() -> Generator[None]:
    """Warn once on stderr if a file uses old names of keys."""
    from replay.machines.old_names import OldNameWarning

    with warnings.catch_warnings():
        warnings.simplefilter("always", OldNameWarning)
        others, shown_messages = warnings.showwarning, set[str]()

        def show_warning_once(message: Warning | str, category: type[Warning], *rest: Any) -> None:
            if category is not OldNameWarning:
                others(message, category, *rest)
            elif str(message) not in shown_messages:
                shown_messages.add(str(message))
                typer.echo(f"payscope: {join_to_one_line(str(message))}", err=True)

        warnings.showwarning = show_warning_once
        yield


def _discard_buffered_stdout() -> None:
    """Discard buffered output, so that the flush at exit cannot fail again."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _print_error_and_get_exit_status(error_text: str) -> int:
    """Print an error in one line on stderr, and return the exit status."""
    typer.echo(f"payscope: {' '.join(error_text.split())}", err=True)
    return 2
