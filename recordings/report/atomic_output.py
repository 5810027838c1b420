"""Write outputs that are never partial: complete files, or files that grow by complete records."""

import secrets
import shutil
from collections.abc import Generator, Iterable, Sequence
from contextlib import contextmanager
from io import FileIO
from pathlib import Path
from typing import Final

from estimators.errors import OutputError

#: Kinds of folders that payscope writes as a whole, by the file that identifies them.
_WRITTEN_WHOLE: Final = {
    "metadata.yaml": "a rosbag2 directory",
    "evidence.json": "evidence",
    "payscope-log.json": "a converted log",
}


class AppendOnlyFile:
    """A file that grows by complete records, and exists from the first one on.

    Attributes:
        path: path of the file.
        size: bytes of complete records.
    """

    def __init__(self, path: Path, size: int = 0) -> None:
        """Create a file, or continue one after its first `size` bytes.

        Raises:
            OSError: the file cannot be written to.
        """
        self.path, self.size = path, size
        self._file: FileIO | None = None
        if size:
            self._truncate_after_last_record(self._open_for_appending())

    def append_record(self, record_bytes: bytes) -> None:
        """Append a record; if that fails, truncate the file after its last complete record.

        Raises:
            OSError: the record does not fit on the disk.
        """
        rest = memoryview(record_bytes)
        file = self._file or self._open_for_appending()
        try:
            while rest:
                rest = rest[file.write(rest) :]
        except OSError:
            self._truncate_after_last_record(file)
            raise
        self.size += len(record_bytes)

    def move_to_path(self, path: Path) -> None:
        """Rename the file."""
        self.path = self.path.replace(path)

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            self._file.close()

    def _open_for_appending(self) -> FileIO:
        self._file = self.path.open("r+b" if self.size else "wb", buffering=0)
        return self._file

    def _truncate_after_last_record(self, file: FileIO) -> None:
        """Cut off an incomplete record at the end."""
        file.truncate(self.size)
        file.seek(self.size)


@contextmanager
def stage_output_files(targets: Sequence[Path], *, overwrites: bool) -> Generator[Path]:
    """Context with a hidden folder for writing the targets; they are moved into place at the end.

    Args:
        targets: files or folders with a common parent.
        overwrites: whether existing targets may be replaced (a folder only if it is a rosbag2
            directory, a converted log or evidence).

    Raises:
        OutputError: a target already exists, or the folder cannot be written to.
    """
    with make_staging_folder(targets, overwrites=overwrites) as stage:
        try:
            yield stage
            for target in targets:
                _replace_target(stage / target.name, target)
        except OSError as error:
            reason = error.strerror or error
            raise OutputError(f"{targets[0]}: cannot be written ({reason})") from None
        except OutputError as error:  # on a file in the stage: report the path that the user gave
            raise OutputError(str(error).replace(str(stage), str(stage.parent))) from None


@contextmanager
def stage_output_file(target: Path, *, overwrites: bool) -> Generator[Path]:
    """Context with a temporary name for one file, which is moved to `target` at the end."""
    _refuse_folder_as_target(target)
    with stage_output_files([target], overwrites=overwrites) as stage:
        yield stage / target.name


def require_writable_folder(target: Path, *, overwrites: bool, marker: str | None = None) -> None:
    """Raise an error, before any work, if an output folder cannot be created.

    Args:
        target: folder to write.
        overwrites: whether an existing folder of the same kind may be replaced.
        marker: file that identifies the kind; None for a folder that is never replaced.

    Raises:
        OutputError: the folder already exists, or its parent cannot be written to.
    """
    for other, kind in _WRITTEN_WHOLE.items():
        if marker not in (None, other) and (target / other).is_file():
            raise OutputError(
                f"{target}: is {kind}, which is not replaced by {_WRITTEN_WHOLE[marker]}; give "
                "another output"
            )
    with make_staging_folder([target], overwrites=overwrites):
        pass


def require_writable_output(target: Path, *, overwrites: bool) -> None:
    """Raise an error, before any work, if an output file cannot be created.

    Raises:
        OutputError: the file already exists, or its folder cannot be written to.
    """
    _refuse_folder_as_target(target)
    with make_staging_folder([target], overwrites=overwrites):
        pass


def refuse_input_as_output(target: Path, inputs: Iterable[Path]) -> None:
    """Raise an error if an output would overwrite an input, even with `--force`.

    A folder that payscope writes as a whole is replaced with everything in it; in any other folder,
    only single files are replaced.

    Raises:
        OutputError: the target is an input, or a folder with an input in it that is replaced.
    """
    if not target.exists() or (target.is_dir() and not _is_folder_written_whole(target)):
        return
    for each in inputs:
        if target.samefile(each):
            raise OutputError(f"{target}: is also an input; give another output")
        if target.is_dir() and target.resolve() in each.resolve().parents:
            raise OutputError(
                f"{target}: would be replaced with the input {each} in it; give another output"
            )


def _refuse_folder_as_target(target: Path) -> None:
    if target.is_dir():
        raise OutputError(f"{target}: is a folder; give a file in it")


@contextmanager
def make_staging_folder(targets: Sequence[Path], *, overwrites: bool) -> Generator[Path]:
    """Context with a hidden folder next to the targets, which is always removed at the end."""
    folder = targets[0].parent
    if not folder.is_dir():
        raise OutputError(f"{targets[0]}: no folder '{folder}'; create it first")
    # named before it is created, so that it can be removed if a signal arrives meanwhile
    stage = folder / f".payscope-{secrets.token_hex(4)}"
    try:
        try:
            for target in targets:
                _refuse_to_overwrite(target, overwrites=overwrites)
            stage.mkdir(mode=0o700)
        except OSError as error:
            raise OutputError(
                f"{targets[0]}: cannot write in '{folder}' ({error.strerror}); give a folder with "
                "write permission"
            ) from None
        yield stage
    finally:
        try:
            shutil.rmtree(stage, ignore_errors=True)
        except BaseException:  # a signal during the removal
            shutil.rmtree(stage, ignore_errors=True)
            raise


def _refuse_to_overwrite(target: Path, *, overwrites: bool) -> None:
    if target.is_dir() and not _is_folder_written_whole(target):
        raise OutputError(
            f"{target}: is a folder, but not a rosbag2 directory, converted log or evidence, so it "
            "is not replaced; give another output"
        )
    if target.exists() and not overwrites:
        raise OutputError(
            f"{target}: exists already; give another output, or --force to replace it"
        )


def _is_folder_written_whole(folder: Path) -> bool:
    return any((folder / name).is_file() for name in _WRITTEN_WHOLE)


def _replace_target(finished_output: Path, target: Path) -> None:
    """Move the output into place, over an existing file or folder."""
    # only a file can replace an existing path by renaming, and only a file
    if not (target.exists() and (target.is_dir() or finished_output.is_dir())):
        finished_output.replace(target)
        return
    replaced = finished_output.with_name(f"{target.name}.replaced")
    try:
        target.replace(replaced)
        finished_output.replace(target)
    except BaseException:  # an error or signal between the two steps: restore the old output
        if replaced.exists() and not target.exists():
            replaced.replace(target)
        raise
