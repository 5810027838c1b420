"""`explain --apply` does no harm: what does not hold on the other half of a log is not written."""

import pytest

from benchmarks.applied import applied
from benchmarks.unlisted_rows import UNLISTED

BY_NAME = {fault.name: fault for fault in UNLISTED}
SIMULATED, INDEPENDENT = 2_900_000, 2_900_001


@pytest.mark.heavy
def test_one_wheel_that_turns_too_far_is_no_radius() -> None:
    made = applied(BY_NAME["left wheel high"], INDEPENDENT)
    assert made.causes == ["unlike_sides"]
    assert made.before is not None
    assert made.after is not None
    assert abs(made.after[0] - made.true_kg) <= abs(made.before[0] - made.true_kg)
    assert not made.is_harmed


@pytest.mark.slow
def test_wheels_in_rpm_leave_accelerometer_and_torques_alone() -> None:
    made = applied(BY_NAME["speed in another unit"], SIMULATED)
    assert made.before is None
    assert made.causes == ["wrong_unit"]
    assert made.after is not None
    assert not made.is_harmed


@pytest.mark.heavy
def test_of_an_imu_that_rocks_nothing_is_mended() -> None:
    made = applied(BY_NAME["IMU loose"], SIMULATED)
    assert made.causes == []
    assert made.after == made.before
    assert "imu loose explains this finding and is still present" in {
        why for _, why in made.taken_back
    }
