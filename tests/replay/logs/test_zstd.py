"""Messages that rosbag2 compressed one by one: unpacked in bounded memory, or counted as lost."""

import tracemalloc

import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st

from replay.logs.messages.raw_batch import make_batch_of_messages
from replay.logs.rosbag2.rosbag2_directory import iter_decompressed_messages

MIB = 2**20


def packed(content: bytes, *, declared: bool) -> bytes:
    """A frame that tells its size, or does not."""
    stream = zstandard.ZstdCompressor(write_content_size=declared).compressobj(
        len(content) if declared else -1
    )
    frame = stream.compress(content) + stream.flush()
    assert (zstandard.frame_content_size(frame) >= 0) == declared
    return frame


def unpacked(frames: list[bytes]) -> tuple[list[tuple[int, bytes]], int]:
    """Times and contents of those that can be unpacked, and how many cannot."""
    found, failed = [], 0
    for batch, lost in iter_decompressed_messages(
        make_batch_of_messages(7, range(len(frames)), frames)
    ):
        found += zip(batch.log_times.tolist(), batch.iter_messages(), strict=True)
        failed += lost
    return found, failed


@given(
    st.lists(st.tuples(st.binary(max_size=4000), st.integers(1, 100), st.booleans()), max_size=5)
)
def test_messages_come_back_whether_their_frames_tell_a_size_or_not(
    recorded: list[tuple[bytes, int, bool]],
) -> None:
    contents = [content * times for content, times, _ in recorded]
    frames = [packed(c, declared=d) for c, (_, _, d) in zip(contents, recorded, strict=True)]
    assert unpacked(frames) == (list(enumerate(contents)), 0)


@given(st.binary(min_size=1, max_size=4000), st.booleans(), st.data())
def test_a_frame_that_breaks_off_costs_itself(
    content: bytes, declared: bool, data: st.DataObject
) -> None:
    frame = packed(content, declared=declared)
    torn = frame[: data.draw(st.integers(0, len(frame) - 1))]
    assert unpacked([frame, torn, frame]) == ([(0, content), (2, content)], 1)


@pytest.mark.heavy
@settings(max_examples=8, deadline=None)  # hundreds of MB
@given(st.integers(70 * MIB, 300 * MIB), st.booleans())
def test_a_bomb_of_any_size_costs_itself_and_bounded_memory(size: int, declared: bool) -> None:
    bomb = packed(bytes(size), declared=declared)
    assert len(bomb) < 20_000
    tracemalloc.start()
    try:
        assert unpacked([b"", bomb, packed(b"whole", declared=declared)]) == ([(2, b"whole")], 2)
        assert tracemalloc.get_traced_memory()[1] < 90 * MIB
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("declared", [True, False])
def test_a_message_of_nothing_but_zeros_is_no_bomb_up_to_the_size_of_images(
    declared: bool,
) -> None:
    image = bytes(32 * MIB)
    assert unpacked([packed(image, declared=declared)]) == ([(0, image)], 0)
