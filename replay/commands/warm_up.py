"""`payscope warm-up`: compile the numerical code before the first replay."""

from typing import Annotated

import typer


def command(
    force: Annotated[
        bool, typer.Option(help=("Compile all loops again, even if they are cached."))
    ] = False,
) -> None:
    """Compile the numerical code in advance: a minute and a half, once per version.

    Without it the first short log takes some seconds more, and a longer one waits until the loops
    that it needs are compiled. Several processes may compile at once.
    """
    from estimators.compile_cache import (
        are_all_loops_cached,
        find_persistent_cache_folder,
        record_that_all_loops_are_cached,
    )
    from estimators.errors import OutputError

    folder = find_persistent_cache_folder()
    if folder is None:
        raise OutputError(
            "compiled code cannot be cached: neither the package's folder nor ~/.cache is "
            "writable; set NUMBA_CACHE_DIR to a writable folder"
        )
    if force or not are_all_loops_cached():
        from replay.commands.progress_bar import StageProgress
        from replay.warm_up.compile_loops import STEPS, compile_all_loops

        with StageProgress(len(STEPS), warns_of_slow_compilation=False) as stages:
            compile_all_loops(stages.begin_stage)
        record_that_all_loops_are_cached()
    typer.echo(f"everything is compiled: {folder}")
