"""What `init` proposes for the IMU's mounting."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from analysis.model.machine_body import ImuMounting
from analysis.stages.signals.mounting import compute_rotation_to_machine_axes
from replay import TimeAxis, load_machine, open_log
from replay.init.guess_machine import draft_machine_file
from tests.analysis import phased

AXES = ("specific_force_x_m_s2", "specific_force_y_m_s2", "specific_force_z_m_s2")
RATES = ("roll_rate_rad_s", "pitch_rate_rad_s", "yaw_rate_rad_s")


def table(path: Path, imu: ImuMounting, *, wheels: bool = True) -> Path:
    """A table of nine starts with an IMU that sits so."""
    t_ns, acc = phased.sampled("imu", 100.0, noise=0.0)
    _, speed = phased.sampled("speed", 100.0)
    _, force = phased.sampled("force", 100.0)
    level = np.stack([acc, 0 * acc, 0 * acc + 9.80665], axis=1)
    seen = level @ compute_rotation_to_machine_axes(imu) + 0.02 * np.random.default_rng(1).normal(
        size=level.shape
    )
    columns = {"time_s": (t_ns - t_ns[0]) / 1e9, "force_x_N": force}
    columns |= dict(zip(AXES, seen.T, strict=True))
    columns |= dict.fromkeys(RATES, 0.0 * acc)
    columns |= {"speed_x_m_s": speed} if wheels else {"speed": speed}
    pl.DataFrame(columns).write_csv(path)
    return path


def drafted(path: Path, time: TimeAxis | None = None) -> str:
    with open_log(path, time=time) as log:
        return draft_machine_file(log, time)[0]


def test_a_rotated_imu_is_written_into_the_file_and_weighs(tmp_path: Path) -> None:
    imu = ImuMounting(roll_deg=90.0, pitch_deg=0.0, yaw_deg=-90.0)
    log = table(tmp_path / "log.csv", imu)
    text = drafted(log, TimeAxis("time_s", "s"))
    made = tmp_path / "machine.toml"
    made.write_text(text, encoding="utf-8")
    found = load_machine(made).machine.imu
    np.testing.assert_allclose(
        compute_rotation_to_machine_axes(found), compute_rotation_to_machine_axes(imu), atol=1e-9
    )
    assert "at standstill: the IMU is mounted so" in text


def test_without_wheels_the_yaw_is_left_to_the_reader(tmp_path: Path) -> None:
    log = table(tmp_path / "log.csv", ImuMounting(roll_deg=90.0), wheels=False)
    text = drafted(log, TimeAxis("time_s", "s"))
    assert "\n# roll_deg = 90\n" in text
    assert "# yaw_deg = 0" in text
    assert "[machine.imu]" not in text.replace("# [machine.imu]", "")


@pytest.mark.parametrize("tilt_deg", [0.0, 5.0])
def test_a_tilt_that_the_ground_may_have_is_only_a_comment(tmp_path: Path, tilt_deg: float) -> None:
    log = table(tmp_path / "log.csv", ImuMounting(pitch_deg=tilt_deg))
    text = drafted(log, TimeAxis("time_s", "s"))
    made = tmp_path / "machine.toml"
    made.write_text(text, encoding="utf-8")
    assert load_machine(made).machine.imu == ImuMounting()
    assert ("# pitch_deg = 5" in text) == (tilt_deg == 5.0)
    assert ("machine.imu" in text) == (tilt_deg == 5.0)


def test_a_huskys_gravity_is_on_z_and_its_starts_tell_no_yaw(shared_data: Path) -> None:
    """Seen in the data; it never stands, and its IMU shows more shaking than motion."""
    text = drafted(shared_data / "logs" / "husky_asphalt.bag")
    assert "# gravity lies 0° off the IMU's z axis on average over the drive: level." in text
    assert "machine.imu" not in text
