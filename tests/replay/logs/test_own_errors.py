"""An error of our own code is never reported as damage of a log, whichever function has it."""

import gc
import sys
import threading
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import pytest

import replay
from estimators.errors import LogError
from replay import open_log
from replay.logs import message_definitions
from tests.replay.logs.damaged import overwrite
from tests.replay.logs.fuzz.sources import SOURCES

FOLDERS = ("logs",)
OWN = tuple(str(Path(str(replay.__file__)).parent / name) for name in FOLDERS)
FORMATS = {
    "bag": ("bag_lz4", "bag_without_index"),
    "mcap": ("mcap_zstd", "mcap_unchunked"),
    "db3": ("db3",),
    "rosbag2": ("rosbag2_split", "rosbag2_db3_message_zstd", "rosbag2_mcap_file_zstd"),
    "csv": ("csv",),
    "parquet": ("parquet",),
}


class OwnError(TypeError, KeyError):
    """Of the kinds that libraries raise on broken bytes."""


def read_everything(path: Path) -> None:
    """Describe, read and check a log, with its definitions compiled anew."""
    message_definitions._make_type_from_ros_definition.cache_clear()
    with suppress(LogError), open_log(path) as log:
        for row in log.topics().iter_rows(named=True):
            if row["problem"] is None:
                log.read(row["topic"], row["fields"])
        log.check()
        log.losses()


@contextmanager
def on_every_call(look: Callable[[CodeType], None]) -> Iterator[None]:
    """Show each function of ours when it is called, in any thread."""

    # a generator that goes on, or is closed by the collector, is not called
    begins: dict[CodeType, int] = {}

    def trace(frame: FrameType, event: str, arg: Any) -> None:
        del event, arg
        code = frame.f_code
        is_call = frame.f_lasti == begins.setdefault(code, frame.f_lasti)
        if is_call and code.co_filename.startswith(OWN):
            look(code)

    before = sys.gettrace()
    threading.settrace(trace)
    sys.settrace(trace)
    try:
        yield
    finally:
        sys.settrace(before)
        threading.settrace(before)


def damaged(path: Path) -> None:
    file = max(path.iterdir(), key=lambda p: p.stat().st_size) if path.is_dir() else path
    for share in (0.3, 0.6):
        overwrite(file, int(share * file.stat().st_size), b"\xff" * 40)


# an error where a file is closed leaves it open
@pytest.mark.heavy
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.filterwarnings("ignore::ResourceWarning")
@pytest.mark.parametrize("log_format", FORMATS)
@pytest.mark.parametrize("every", [pytest.param(1, marks=pytest.mark.slow), 16])
def test_an_error_in_any_function_that_reads_a_format_is_no_damage(
    tmp_path: Path, log_format: str, every: int
) -> None:
    tried: set[CodeType] = set()
    hidden: list[str] = []
    for name in FORMATS[log_format]:
        (folder := tmp_path / name).mkdir()
        path = SOURCES[name](folder).path
        for make_worse in (lambda _: None, damaged):
            make_worse(path)
            read_everything(path)  # compiles what is compiled
            called: set[CodeType] = set()
            with on_every_call(called.add):
                read_everything(path)
            for code in sorted(called - tried, key=lambda c: c.co_qualname)[::every]:
                # a loop that was interpreted may be compiled by now, and is then not called
                raised: list[OwnError] = []

                def fail(seen: CodeType, code: CodeType = code, raised: Any = raised) -> None:
                    if seen is code:
                        raised.append(OwnError())
                        raise raised[-1]

                try:
                    with on_every_call(fail):
                        read_everything(path)
                except OwnError as error:
                    # generators that it left are closed here, not as calls in the next turn
                    traceback.clear_frames(error.__traceback__)
                    continue
                if raised:
                    hidden.append(f"{Path(code.co_filename).name}: {code.co_qualname}")
            tried |= called
    gc.collect()  # what was left open is closed here, and warns no other test
    assert len(tried) > 20
    assert not hidden
