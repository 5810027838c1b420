"""Blocks of a file: what of their compressed bytes is believed."""

import struct
from pathlib import Path

import numpy as np
import pytest
import zstandard
from hypothesis import given
from hypothesis import strategies as st

from replay.logs.blocks.block import Block, DamagedBlockError, unpack_block_into
from replay.logs.storage.file_bytes import FileBytes
from tests.twins import mark_heavy_after

CONTENT = np.random.default_rng(1).bytes(3000) * 40
SKIPPED = struct.pack("<II", 0x184D2A5F, 5) + b"aside"


def packed(content: bytes, *, checksum: bool = False, sized: bool = True) -> bytes:
    packer = zstandard.ZstdCompressor(write_checksum=checksum, write_content_size=sized)
    stream = packer.compressobj(len(content) if sized else -1)
    return stream.compress(content) + stream.flush()


def unpacked(folder: Path, stored: bytes, declared: int, *, is_truncated: bool = False) -> bytes:
    """What comes out of a zstd block that is a file of its own."""
    path = folder / "block"
    path.write_bytes(stored)
    file = FileBytes(path)
    block = Block(0, 0, len(stored), "zstd", declared, is_truncated=is_truncated)
    target = np.zeros(block.max_unpacked_bytes, np.uint8)
    try:
        return target[: unpack_block_into(block, file, target)].tobytes()
    finally:
        file.close()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("blocks")


FRAMES = {
    "one frame": packed(CONTENT),
    "with a checksum": packed(CONTENT, checksum=True),
    "of a size not told": packed(CONTENT, sized=False),
    "two frames": packed(CONTENT[:500]) + packed(CONTENT[500:], checksum=True),
    "an empty frame first": packed(b"") + packed(CONTENT),
    "frames to be skipped": SKIPPED + packed(CONTENT[:500]) + SKIPPED + packed(CONTENT[500:]),
}


@pytest.mark.parametrize("make", FRAMES)
def test_frames_of_any_make_are_unpacked(folder: Path, make: str) -> None:
    assert unpacked(folder, FRAMES[make], len(CONTENT)) == CONTENT


@pytest.mark.parametrize("make", mark_heavy_after(1, FRAMES))
@given(data=st.data())
def test_frames_without_their_end_are_damaged_even_if_all_content_is_there(
    folder: Path, make: str, data: st.DataObject
) -> None:
    cut = data.draw(st.integers(1, 14) | st.integers(1, len(FRAMES[make])))
    with pytest.raises(DamagedBlockError):
        unpacked(folder, FRAMES[make][:-cut], len(CONTENT))


@given(behind=st.binary(min_size=1, max_size=12) | st.sampled_from([b"\x28", b"\x28\xb5\x2f"]))
def test_bytes_behind_the_last_frame_are_damage(folder: Path, behind: bytes) -> None:
    with pytest.raises(DamagedBlockError):
        unpacked(folder, packed(CONTENT) + behind, len(CONTENT))


@pytest.mark.parametrize("more", [-1, 1])
def test_one_byte_more_or_less_than_declared_is_damage(folder: Path, more: int) -> None:
    with pytest.raises(DamagedBlockError, match="bytes it declares"):
        unpacked(folder, packed(CONTENT), len(CONTENT) + more)


def test_an_empty_chunk_is_empty_whether_it_was_packed_or_not(folder: Path) -> None:
    assert unpacked(folder, b"", 0) == unpacked(folder, packed(b""), 0) == b""


def test_what_the_end_of_the_file_left_of_a_torn_block_counts(folder: Path) -> None:
    content = np.random.default_rng(2).bytes(400_000)  # of several blocks of zstd's
    for cut in (1, 100_000, 399_990):
        part = unpacked(folder, packed(content)[:-cut], len(content), is_truncated=True)
        assert content.startswith(part)
        assert len(part) > len(content) - cut - 2**17


def test_a_frame_that_asks_for_a_gibibyte_of_memory_is_refused(folder: Path) -> None:
    wide = zstandard.ZstdCompressionParameters(window_log=30)
    stream = zstandard.ZstdCompressor(compression_params=wide).compressobj()
    frame = stream.compress(CONTENT) + stream.flush()
    with pytest.raises(DamagedBlockError, match="memory"):
        unpacked(folder, frame, len(CONTENT))
