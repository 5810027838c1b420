"""The first use of an unknown key, asked on a terminal as SSH does."""

import sys
from collections.abc import Callable
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from recordings.signatures.signed_by import SignedBy


def first_use() -> "Callable[[SignedBy], str] | None":
    """What asks the user about an unknown key; None where nobody sits at a terminal."""
    at_terminal = sys.stdin.isatty() and sys.stderr.isatty()
    return _ask_owner if at_terminal else None


def _ask_owner(by: "SignedBy") -> str:
    """Ask whose key it is; "" where it is not to be trusted."""
    from estimators.errors import one_line

    typer.echo(f"This evidence is {one_line(str(by))}.", err=True)
    typer.echo(f"SHA-256 of the key: {by.key_id}", err=True)
    typer.echo("Compare it with what the signer told you by another way.", err=True)
    return typer.prompt(
        "Whose key is it? (a name keeps the key, nothing refuses it)",
        default="",
        show_default=False,
        err=True,
    )
