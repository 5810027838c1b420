"""A file through a pipe: all of it is there in the end, and nothing of it once it is given up."""

from pathlib import Path

import pytest

from recordings.rrd.piped_file import open_piped_file

FDS = Path("/dev/fd")
BYTES = bytes(range(256)) * 20_000


def test_what_the_library_writes_is_in_the_file(tmp_path: Path):
    path, before = tmp_path / "file", len(list(FDS.iterdir()))
    with open_piped_file(path) as piped, Path(piped.name).open("wb") as library:
        piped.close_writing_end()
        library.write(BYTES)
    assert path.read_bytes() == BYTES
    assert len(list(FDS.iterdir())) == before


def test_a_file_that_is_given_up_and_removed_does_not_come_back(tmp_path: Path):
    for _ in range(20):
        with pytest.raises(KeyError), open_piped_file(tmp_path / "file"):
            raise KeyError
        (tmp_path / "file").unlink()
    assert not any(tmp_path.iterdir())


def test_a_folder_that_is_not_there_is_said_at_once(tmp_path: Path):
    with pytest.raises(FileNotFoundError), open_piped_file(tmp_path / "nowhere/file"):
        pass
