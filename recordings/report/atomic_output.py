"""Outputs that are never torn: whole or not there, or growing by whole pieces."""

import secrets
import shutil
from collections.abc import Generator, Iterable, Sequence
from contextlib import contextmanager
from io import FileIO
from pathlib import Path
from typing import Final

from estimators.errors import OutputError

#: What shows that a folder is one that payscope writes whole.
_OURS: Final = ("metadata.yaml", "evidence.json", "payscope-log.json")


class AppendedFile:
    """A file that is appended to, and there from its first piece on.

    Attributes:
        path: of the file.
        size: bytes of whole pieces.
    """

    def __init__(self, path: Path, size: int = 0) -> None:
        """Begin a file, or go on behind the first `size` bytes of one.

        Raises:
            OSError: it cannot be written to.
        """
        self.path, self.size = path, size
        self._file: FileIO | None = None
        if size:
            self._cut(self._open())

    def append(self, piece: bytes) -> None:
        """Append a piece.

        Raises:
            OSError: it does not fit on the disc.
        """
        rest = memoryview(piece)
        file = self._file or self._open()
        try:
            while rest:
                rest = rest[file.write(rest) :]
        except OSError:
            self._cut(file)
            raise
        self.size += len(piece)

    def rename(self, path: Path) -> None:
        """Give the file another name."""
        self.path = self.path.replace(path)

    def close(self) -> None:
        """Close the file as it is."""
        if self._file is not None:
            self._file.close()

    def _open(self) -> FileIO:
        self._file = self.path.open("r+b" if self.size else "wb", buffering=0)
        return self._file

    def _cut(self, file: FileIO) -> None:
        file.truncate(self.size)
        file.seek(self.size)


@contextmanager
def atomic_files(targets: Sequence[Path], *, force: bool) -> Generator[Path]:
    """A hidden folder to write the targets in, under their own names; then they move into place.

    Args:
        targets: files or folders of one folder.
        force: whether what is there may be replaced (a folder only if it is a rosbag2 directory, a
            converted log or evidence).

    Raises:
        OutputError: a target is there already, or their folder cannot be written to.
    """
    with staging_folder(targets, force=force) as stage:
        try:
            yield stage
            for target in targets:
                _move(stage / target.name, target)
        except OSError as error:
            reason = error.strerror or error
            raise OutputError(f"{targets[0]}: cannot be written ({reason})") from None


@contextmanager
def atomic_file(target: Path, *, force: bool) -> Generator[Path]:
    """A name to write one file under; it moves to `target` when it is whole."""
    _refuse_folder(target)
    with atomic_files([target], force=force) as stage:
        yield stage / target.name


def require_writable_folder(target: Path, *, force: bool) -> None:
    """Refuse a folder as an output before the work that it is for.

    Raises:
        OutputError: it is there already, or its parent cannot be written to.
    """
    with staging_folder([target], force=force):
        pass


def require_writable_output(target: Path, *, force: bool) -> None:
    """Refuse an output before the work that it is for, rather than after.

    Raises:
        OutputError: the target is there already, or its folder cannot be written to.
    """
    _refuse_folder(target)
    with staging_folder([target], force=force):
        pass


def refuse_input_as_output(target: Path, inputs: Iterable[Path]) -> None:
    """Refuse, also with `--force`, to write over what is being read.

    Raises:
        OutputError: the target is one of the inputs.
    """
    if target.exists() and any(target.samefile(each) for each in inputs):
        raise OutputError(f"{target}: is the input itself; name another output")


def _refuse_folder(target: Path) -> None:
    if target.is_dir():
        raise OutputError(f"{target}: is a folder; name a file in it")


@contextmanager
def staging_folder(targets: Sequence[Path], *, force: bool) -> Generator[Path]:
    """A hidden folder beside the targets, which goes whatever happens."""
    folder = targets[0].parent
    if not folder.is_dir():
        raise OutputError(f"{targets[0]}: no folder '{folder}'; create it first")
    # it has its name before it is there: a signal that comes with it finds what to remove
    stage = folder / f".payscope-{secrets.token_hex(4)}"
    try:
        try:
            for target in targets:
                _refuse_to_overwrite(target, force=force)
            stage.mkdir(mode=0o700)
        except OSError as error:
            raise OutputError(
                f"{targets[0]}: cannot write in '{folder}' ({error.strerror}); "
                "name a folder that you may write in"
            ) from None
        yield stage
    finally:
        try:
            shutil.rmtree(stage, ignore_errors=True)
        except BaseException:  # a signal that comes while it goes
            shutil.rmtree(stage, ignore_errors=True)
            raise


def _refuse_to_overwrite(target: Path, *, force: bool) -> None:
    if target.is_dir() and not any((target / name).is_file() for name in _OURS):
        raise OutputError(
            f"{target}: is a folder and no rosbag2 directory, converted log or evidence; name "
            "another output"
        )
    if target.exists() and not force:
        raise OutputError(f"{target}: exists already; name another output, or give --force")


def _move(written: Path, target: Path) -> None:
    # only a file can be renamed over what is there, and only over a file
    if target.exists() and (target.is_dir() or written.is_dir()):
        target.replace(written.with_name(f"{target.name}.replaced"))
    written.replace(target)
