"""Rows in the order of their log times, rows of one time in the order of the file."""

import polars as pl
from hypothesis import given
from hypothesis import strategies as st

from replay.logs.decoding.batch_stream import merge_sorted_frames, sort_batch_by_log_time
from replay.logs.messages.raw_batch import make_batch_of_messages

TIMES = st.lists(st.lists(st.integers(0, 30), max_size=12), min_size=1, max_size=8)


def frames_of(times: list[list[int]]) -> list[pl.DataFrame]:
    """Frames that are each in order, with the number that each row has in all of them."""
    frames: list[pl.DataFrame] = []
    first = 0
    for part in times:
        numbers = range(first, first + len(part))
        frame = pl.DataFrame(
            {"log_time_ns": part, "number": numbers},
            schema={"log_time_ns": pl.Int64, "number": pl.Int64},
        )
        frames.append(frame.sort("log_time_ns", maintain_order=True))
        first += len(part)
    return frames


@given(TIMES)
def test_joined_frames_are_what_one_stable_sort_of_all_rows_gives(times: list[list[int]]) -> None:
    frames = frames_of(times)
    expected = pl.concat(frames).sort("log_time_ns", maintain_order=True)
    assert merge_sorted_frames(frames).equals(expected)


@given(st.integers(1, 10), st.integers(0, 40))
def test_a_clock_that_jumps_back_is_put_in_order_too(rows: int, back: int) -> None:
    frames = frames_of([[50 + k for k in range(rows)], [50 - back + k for k in range(rows)], [9]])
    expected = pl.concat(frames).sort("log_time_ns", maintain_order=True)
    assert merge_sorted_frames(frames).equals(expected)


def test_where_nothing_overlaps_no_row_is_copied() -> None:
    frames = frames_of([[1, 2], [2, 3], [3, 7], [8]])
    together = merge_sorted_frames(frames)
    assert together.n_chunks() == len(frames)
    assert together["number"].to_list() == list(range(7))


@given(st.lists(st.integers(0, 5), max_size=30))
def test_messages_of_a_batch_are_sorted_and_keep_their_bytes(times: list[int]) -> None:
    batch = sort_batch_by_log_time(
        make_batch_of_messages(7, times, [b"%d" % k for k in range(len(times))])
    )
    order = sorted(range(len(times)), key=lambda k: times[k])
    assert batch.log_times.tolist() == sorted(times)
    assert list(batch.iter_messages()) == [b"%d" % k for k in order]
