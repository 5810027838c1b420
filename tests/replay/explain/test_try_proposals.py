"""A small twin of `make mended`: what `explain --apply` makes of a log with a fault in it."""

import pytest

from benchmarks.findings_trials import BY_NAME, base
from benchmarks.mended import AXES, MendedTrial, table, trial
from tests.trials.drawn_designs import Sections, join_designs
from tests.twins import mark_slow_after

#: Of what has one of its own in no design.
SIZE = 3.0
#: The IMU cannot be turned back without them.
_TURNED_BACK = ("roll_rate", "pitch_rate")


def design(name: str) -> Sections:
    fault = BY_NAME[name]
    sections = base(1_300_000, [fault])
    return (
        sections if fault.ground is None else join_designs(sections, fault.ground(sections, SIZE))
    )


def off_kg(mended: MendedTrial) -> float:
    """How far the mended mass is from that of the log without the fault, in its true mass."""
    assert mended.mended_kg is not None
    assert mended.clean_kg is not None
    return abs(mended.mended_kg - mended.clean_kg) / mended.true_kg


@pytest.mark.heavy
@pytest.mark.parametrize(
    ("name", "size", "cause"),
    mark_slow_after(
        1,
        [
            ("speed late", 4.0, "delay"),
            ("sides swapped", 3.0, "swapped_sides"),
            ("wheels larger", 6.0, "wheel_radius"),
            ("IMU turned", 3.0, "imu_misaligned"),
            ("slope, no gravity", 3.0, "slope"),
        ],
    ),
)
def test_a_mended_machine_file_gives_the_mass_back(name: str, size: float, cause: str) -> None:
    mended = trial(BY_NAME[name], design(name), size)
    assert {change[0] for change in mended.changes} == {cause}
    assert off_kg(mended) < 0.005
    assert mended.weighs[1]
    assert mended.left == ()


@pytest.mark.slow
def test_what_moves_the_mass_as_claimed_is_kept_and_what_it_explains_is_not_mended() -> None:
    """Without all its axes an IMU is not turned back: its share of the motion is scaled."""
    axes = {key: value for key, value in AXES.items() if not key.startswith(_TURNED_BACK)}
    mended = trial(BY_NAME["IMU turned"], design("IMU turned"), 3.0, axes)
    assert [change[:2] for change in mended.changes] == [
        ("imu_misaligned", "channels.specific_force_x_m_s2.scale")
    ]
    assert mended.left == ("imu_misaligned",)
    assert off_kg(mended) < 0.01
    assert "IMU turned" in table([mended])
