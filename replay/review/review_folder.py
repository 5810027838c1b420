"""Folder of a review: locked for one review at a time, and refused if it holds other files."""

import shutil
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from estimators.errors import OutputError, ReviewError
from recordings.review.review_state import RECORDING, STATE, ReviewState
from recordings.review.reviewer_verdicts import VERDICTS
from recordings.review.shift_ledger import PARQUET
from replay.logs import Log

_LOCK: Final = ".lock"
_STAGE: Final = ".payscope-"
#: Name of a file of every rosbag2 directory, which therefore identifies none.
_ROSBAG2_METADATA: Final = "metadata.yaml"


@contextmanager
def lock_review_folder(folder: Path) -> Generator[None]:
    """Lock the folder for this review, and remove the unfinished files of a killed review.

    The system releases the lock when the process ends, however it ends.
    """
    import fcntl

    refuse_unsuitable_review_folder(folder)
    try:
        new = not folder.exists()
        folder.mkdir(exist_ok=True)
        lock = (folder / _LOCK).open("a")
    except OSError as error:
        raise OutputError(f"{folder}: cannot be written ({error.strerror})") from None
    with lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise ReviewError(
                f"{folder}: another process is writing a review to this folder; wait for it, or "
                "give another folder"
            ) from None
        for left in folder.glob(f"{_STAGE}*"):
            shutil.rmtree(left, ignore_errors=True)
        try:
            yield
        finally:
            if new and [each.name for each in folder.iterdir()] == [_LOCK]:
                shutil.rmtree(folder, ignore_errors=True)


def refuse_unsuitable_review_folder(folder: Path) -> None:
    """Raise an error for a folder that holds other files, before the review is computed.

    Raises:
        ReviewError: the folder holds other files and no review.
    """
    if not folder.is_dir() or any((folder / n).is_file() for n in (STATE, PARQUET, RECORDING)):
        return
    foreign = {each.name for each in folder.iterdir() if not each.name.startswith(".")}
    if foreign - {VERDICTS}:
        raise ReviewError(
            f"{folder}: holds other files ({min(foreign - {VERDICTS})}) but no review; give a new "
            "folder"
        )


def refuse_review_of_other_shift(
    folder: Path, review: ReviewState, opened_logs: Sequence[Log]
) -> None:
    """Raise an error if the folder holds the review of another shift, which is not to be replaced.

    Args:
        folder: folder of the review.
        review: state of the review in that folder.
        opened_logs: logs of the new review, with their digests.

    Raises:
        ReviewError: no log of the earlier review is among the new ones, by name or by content.
    """
    names = {file.name for log in opened_logs for file in log.files} - {_ROSBAG2_METADATA}
    digests = {digest for log in opened_logs for digest in log.digests}
    if review.inputs and not any(e.name in names or e.sha256 in digests for e in review.inputs):
        raise ReviewError(
            f"{folder}: holds the review of other logs ({review.inputs[0].name}, "
            f"{review.begins}); give another folder, or --force to replace it"
        )
