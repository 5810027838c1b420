"""What every test may use."""

import os
from pathlib import Path

import pytest

REPO = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Logs recorded by others, which the repository does not hold."""
    named = os.environ.get("PAYSCOPE_SHARED_DATA")
    candidates = [Path(named)] if named else [p / "shared/data" for p in REPO.parents]
    for folder in candidates:
        if folder.is_dir():
            return folder
    pytest.skip("no shared/data in any parent folder; PAYSCOPE_SHARED_DATA may name it")
