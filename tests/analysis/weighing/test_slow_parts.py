"""Where a load may change on the move: the slow parts of a drive."""

import numpy as np
import pytest

from analysis.weighing.fitted_stretches import mark_slow_parts_of_drives

FAST, SLOW, STAND = (np.full(100, speed) for speed in (4.0, 0.8, 0.0))


def marked(*parts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    speed = np.concatenate(parts)
    stands = speed == 0.0
    stops = np.cumsum(stands & ~np.append(False, stands[:-1]))
    return mark_slow_parts_of_drives(speed, stops).reshape(len(parts), -1), speed


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_creep_between_two_drives_is_one(way: float) -> None:
    slow, _ = marked(*(way * part for part in (FAST, SLOW, FAST)))
    assert slow.all(axis=1).tolist() == [False, True, False]
    assert not slow[[0, 2]].any()


def test_where_the_machine_only_stops_there_is_none() -> None:
    slow, _ = marked(STAND, FAST, STAND, FAST, SLOW, STAND, FAST, STAND)
    assert not slow.any()


def test_beside_a_creep_what_is_slow_about_a_stop_counts_as_well() -> None:
    slow, speed = marked(STAND, FAST, STAND, FAST, SLOW, FAST, STAND)
    assert slow[2].all()
    assert slow[4].all()
    # neither at the begin of the log nor at its end
    assert not slow[[0, 6]].any()
    assert not slow.ravel()[speed > 2.0].any()


def test_a_steady_or_a_standing_machine_has_none() -> None:
    assert not marked(FAST, FAST)[0].any()
    assert not marked(STAND, STAND)[0].any()
