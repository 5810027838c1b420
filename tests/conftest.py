"""What every test may use."""

import gc
import os
import time
from pathlib import Path

import pytest
from hypothesis import settings

from tests.made_once import make_folder_once, share_folder
from tests.processor_times import ProcessorTimes
from tests.twins import mark_slow_after

REPO = Path(__file__).resolve().parent.parent
BEGAN = pytest.StashKey[float]()
# each worker has a processor; a pool for so little work waits in turns and takes a fifth of it.
# Threads are the statement of `test_fingerprint.py` and `test_threads.py`
for pool in ("POLARS_MAX_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(pool, "1")
# a machine that is busy is slow, and no test is about time; what failed fails again
settings.register_profile("payscope", deadline=None, derandomize=True)
settings.register_profile("unseen", deadline=None)
settings.load_profile("payscope")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--seconds", type=float, help="skip the tests that are left after so long")
    parser.addoption(
        "--processor-times", action="store_true", help="list what takes most of the processor"
    )


def pytest_configure(config: pytest.Config) -> None:
    config.stash[BEGAN] = time.monotonic()
    if config.getoption("--processor-times"):
        config.pluginmanager.register(ProcessorTimes())
    # the keyring of whoever runs the tests vouches for nothing in them
    os.environ["PAYSCOPE_KEYRING"] = str(REPO / "no-such-folder" / "keys.toml")
    # half of collecting 8,000 tests was looking for cycles among them
    gc.disable()


def pytest_collection_finish() -> None:
    # tests and modules stay to the end: no collection looks at them again
    gc.collect()
    gc.freeze()
    # as often as in a command (`payscope.py`)
    gc.set_threshold(10_000, *gc.get_threshold()[1:])
    gc.enable()


#: Files of 15 s of the processor and more, the longest first (`make test-times`): one processor
#: would wait for the other at the end. xdist would begin with those of the most tests, but for
#: `--no-loadscope-reorder`.
LONG_FILES = (
    "test_documentation.py",
    "test_reproduce_paper.py",
    "test_background_replay.py",
    "test_killed_follower.py",
    "test_explain_run.py",
    "test_import_log.py",
    "test_attack_list.py",
    "test_compare_files.py",
    "test_follow_recorders.py",
    "test_compare_recordings.py",
    "test_real_logs.py",
    "test_verifier_page.py",
    "test_named.py",
    "test_verify_bundle.py",
    "test_faults.py",
    "test_load_states.py",
    "test_run_plots.py",
    "test_compile_loops.py",
    "test_leaving.py",
    "test_planar.py",
    "test_degenerate_tables.py",
    "test_answers.py",
    "test_gain_by_direction.py",
    "test_apply_evidence.py",
    "test_shared_logs.py",
    "test_review_shift.py",
    "test_empty_machine.py",
    "test_viewer.py",
    "test_on_board.py",
    "test_excluded_stretches.py",
    "test_other_machines.py",
    "test_on_board_page.py",
    "test_convert.py",
    "test_dialects.py",
    "test_live_browser.py",
    "test_fingerprint.py",
    "test_give_verdicts.py",
    "test_sweep_settings.py",
    "test_review_inputs.py",
    "test_layers.py",
)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The longest files first."""
    place = {name: number for number, name in enumerate(LONG_FILES)}
    items.sort(key=lambda item: place.get(item.path.name, len(place)))


def pytest_runtest_setup(item: pytest.Item) -> None:
    seconds = item.config.getoption("--seconds")
    if seconds is not None and time.monotonic() - item.config.stash[BEGAN] > seconds:
        pytest.skip(f"the {seconds:g} s are over; make test runs it")


@pytest.fixture
def small_viewer(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of what the viewer draws in software each pixel takes its time."""
    monkeypatch.setattr("recordings.rrd.viewer._WINDOW", "800x500")


@pytest.fixture(scope="session", autouse=True)
def folder_of_workers(tmp_path_factory: pytest.TempPathFactory) -> None:
    """What one of them made, the others find."""
    own = tmp_path_factory.getbasetemp()
    share_folder((own.parent if "PYTEST_XDIST_WORKER" in os.environ else own) / "made-once")


@pytest.fixture(scope="session")
def own_data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Logs of our own making, laid out like those of others."""
    from tests.own_logs import make

    return make_folder_once(tmp_path_factory.getbasetemp() / "own", make)


def folder_of_others() -> Path | None:
    """Logs recorded by others, which the repository does not hold."""
    named = os.environ.get("PAYSCOPE_SHARED_DATA")
    candidates = [Path(named)] if named else [p / "shared/data" for p in REPO.parents]
    return next((folder for folder in candidates if folder.is_dir()), None)


#: Whose logs there are; `tests/test_others.py` says when those of others are not.
WHOSE = ("own", "others") if folder_of_others() else ("own",)


@pytest.fixture(params=WHOSE)
def data(request: pytest.FixtureRequest) -> Path:
    """Logs of our own, then those of others where they are."""
    return request.getfixturevalue("own_data" if request.param == "own" else "shared_data")


@pytest.fixture(params=mark_slow_after(1, WHOSE))
def data_in_kind(request: pytest.FixtureRequest) -> Path:
    """Logs of our own, and in `make slow` those of others that are laid out like them."""
    return request.getfixturevalue("own_data" if request.param == "own" else "shared_data")


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """What only the bytes of others can show; our own logs are asked the rest."""
    folder = folder_of_others()
    if folder is None:
        pytest.skip("bytes of others: no shared/data above, nor named by PAYSCOPE_SHARED_DATA")
    return folder
