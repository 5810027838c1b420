"""`payscope migrate`: rewrite files of an earlier version with the present names of keys."""

from pathlib import Path
from typing import Annotated

import typer


def command(
    files: Annotated[
        list[Path], typer.Argument(help="Machine, campaign, fleet or scenario files (TOML).")
    ],
) -> None:
    """Rewrite files whose keys have old names; comments, order and values are kept."""
    from estimators.errors import join_to_one_line
    from replay.machines.old_names import migrate_toml_file

    for file in files:
        renamed = migrate_toml_file(file)
        if not renamed:
            typer.echo(join_to_one_line(f"{file}: no old names"))
        for old, new in renamed.items():
            typer.echo(join_to_one_line(f"{file}: {old} -> {new}"))
