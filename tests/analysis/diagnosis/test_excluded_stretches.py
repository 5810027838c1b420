"""A check withholds where what it names changes the answer; else that is left out, and said."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from analysis.diagnosis.measured_channels import RawSignals
from benchmarks.dialects.dialect_file import DRIVE
from tests.analysis.limited_car import MASS_KG, Car, Judged
from tests.twins import mark_heavy_after


@cache
def driven(noise_m_s: float = 0.01) -> Car:
    return Car.driven(noise_m_s=noise_m_s)


def starts(car: Car) -> list[tuple[float, float]]:
    """When it begins to pull, and four seconds on."""
    pulls = np.flatnonzero(np.diff((car.force > 2000.0).astype(int)) == 1)
    return [(float(car.t[row]) - 0.2, float(car.t[row]) + 4.0) for row in pulls]


class TestWheelsAgainstTheAccelerometer:
    """Judged by the mass that each says, however noisy the speed is."""

    @pytest.mark.heavy
    @pytest.mark.parametrize("noise_m_s", mark_heavy_after(1, [0.01, 0.3]))
    def test_a_disagreement_that_moves_no_mass_is_told(
        self, noise_m_s: float, tmp_path: Path
    ) -> None:
        car = driven(noise_m_s)
        found = car.but(acc=car.acc + 0.1 * np.sin(2.0 * np.pi * car.t / 40.0)).replayed(tmp_path)
        assert found.check("wheel_imu_residual").passed is False
        assert found.check("wheel_imu_residual").consequence == "tell"
        assert found.verdict.can_weigh
        assert abs(found.error_u) <= 2.0

    @pytest.mark.heavy
    @pytest.mark.parametrize("noise_m_s", mark_heavy_after(1, [0.01, 0.3]))
    def test_one_that_moves_it_leaves_no_answer(self, noise_m_s: float, tmp_path: Path) -> None:
        car = driven(noise_m_s)
        deaf = np.where(np.sin(2.0 * np.pi * car.t / 13.0) > 0.0, 1.0, 0.3)
        found = car.but(acc=car.acc * deaf).replayed(tmp_path)
        # minutes that disagree make the answer poor, beside which the wheels may be near
        assert {check.check for check in found.verdict.list_withholding_checks("mass")} & {
            "wheel_imu_residual",
            "relative_u",
        }
        assert found.check("wheel_imu_residual").passed is False
        assert (
            "with the wheels alone the mass changes by" in found.check("wheel_imu_residual").meaning
        )

    @pytest.mark.heavy
    def test_of_an_acceleration_by_the_wheels_the_accelerometer_is_the_other_one(
        self, tmp_path: Path
    ) -> None:
        car = driven()
        found = car.but(acc=0.3 * car.acc).replayed(
            tmp_path, ("verdict", {"wheels_max": 1e-9}), ("forces", {"acceleration": "kinematic"})
        )
        assert (
            "with the accelerometer alone the mass changes by +"
            in found.check("wheel_imu_residual").meaning
        )

    @pytest.mark.heavy
    def test_a_speed_with_noise_hides_no_part_of_the_accelerometer(self, tmp_path: Path) -> None:
        gain = driven(0.3).replayed(tmp_path).check("acceleration_gain").value
        assert gain == pytest.approx(1.0, abs=0.15)


@pytest.fixture(scope="module")
def a_moment(tmp_path_factory: pytest.TempPathFactory) -> tuple[float, Judged]:
    """When the force freezes for a moment of a start, and what a replay says."""
    begin_s = starts(driven())[1][0] + 1.4
    car = driven().frozen((begin_s, begin_s + 0.6))
    return begin_s, car.replayed(tmp_path_factory.mktemp("moment"))


class TestFrozen:
    """A force that repeats one reading while the car goes on."""

    @pytest.mark.heavy
    def test_a_moment_of_a_long_log_is_left_out_and_told(
        self, a_moment: tuple[float, Judged]
    ) -> None:
        _, found = a_moment
        check = found.check("frozen_s")
        assert (check.passed, check.consequence) == (False, "tell")
        assert (
            "0.7 s of it among the weighed samples, excluded: this moves the mass by"
            in check.meaning
        )
        assert found.verdict.can_weigh
        assert abs(found.error_u) <= 2.0

    def test_the_gate_takes_it_for_a_gap(self, a_moment: tuple[float, Judged]) -> None:
        begin_s, found = a_moment
        gated = found.run.frames["gate"]
        inside = gated.filter((gated["t_ns"] / 1e9).is_between(begin_s + 0.2, begin_s + 0.5))
        assert set(inside["reason_x"].cast(str)) == {"gap"}

    def test_its_finding_withholds_nothing(self, a_moment: tuple[float, Judged]) -> None:
        findings = a_moment[1].run.frames["findings"]
        row = findings.filter(findings["cause"] == "frozen").row(0, named=True)
        assert row["severity"] == "tell"
        assert "excluded: this moves the mass" in row["evidence"]

    @pytest.mark.heavy
    def test_over_the_only_starts_it_withholds(self, tmp_path: Path) -> None:
        found = driven().frozen(*starts(driven())).replayed(tmp_path)
        assert "frozen_s" in {
            check.check for check in found.verdict.list_withholding_checks("mass")
        }
        findings = found.run.frames["findings"]
        assert findings.filter(findings["cause"] == "frozen")["severity"].to_list() == ["withhold"]

    @pytest.mark.heavy
    def test_a_setting_that_allows_it_leaves_it_in(self, tmp_path: Path) -> None:
        found = (
            driven()
            .frozen(*starts(driven()))
            .replayed(tmp_path, ("verdict", {"frozen_max_s": 1e6}))
        )
        assert found.check("frozen_s").passed
        assert not found.load["mass_kg"] or abs(found.load["mass_kg"] - MASS_KG) > 100.0


class TestLimits:
    """A torque that an engine does not exceed, and one that a sensor does not show."""

    @pytest.mark.heavy
    def test_a_torque_at_the_engines_limit_weighs(self, tmp_path: Path) -> None:
        found = Car.driven(limit_N=2500.0).replayed(tmp_path)
        assert found.check("frozen_s").passed
        assert (found.check("clipped_share").passed, found.check("clipped_share").consequence) == (
            False,
            "tell",
        )
        assert found.verdict.can_weigh
        assert abs(found.error_u) <= 2.0

    @pytest.mark.heavy
    def test_a_sensor_that_clips_there_does_not(self, tmp_path: Path) -> None:
        car = driven()
        found = car.but(force=np.minimum(car.force, 2500.0)).replayed(tmp_path)
        assert "clipped_share" in {
            check.check for check in found.verdict.list_withholding_checks("mass")
        }


class TestWhatIsNamed:
    """Channels made by hand."""

    T_NS = np.arange(1000) * 10_000_000

    def signals(self, force: np.ndarray) -> RawSignals:
        return RawSignals(
            {
                "force_x_N": (self.T_NS, force),
                "speed_x_m_s": (self.T_NS, np.linspace(0.0, 3.0, 1000)),
            },
            None,
            10.0,
        )

    def noisy(self) -> np.ndarray:
        return np.random.default_rng(1).normal(0.0, 60.0, 1000)

    def test_a_value_that_a_force_comes_back_to_is_a_limit_though_a_peak_is_beyond(self) -> None:
        force = self.noisy()
        for begin in (100, 400, 800):
            force[begin : begin + 100] = 150.0
        force[850] = 170.0
        found = self.signals(force)
        assert found.longest_frozen_duration_s == 0.0
        assert found.clipped_fraction_and_limit_by_channel["force_x_N"] == (
            pytest.approx(0.299),
            150.0,
        )
        begins_s = [begin / 1e9 for begin, _ in found.clipped_spans["force_x_N"]]
        assert begins_s == pytest.approx([1.0, 4.0, 8.0], abs=0.3)

    def test_once_seen_to_freeze_a_channel_is_frozen_wherever_it_repeats_itself(self) -> None:
        force = self.noisy()
        force[300:500] = force[300]
        force[700:740] = force[700]  # in which the speed hardly changes
        assert len(self.signals(force).frozen_spans["force_x_N"]) == 2

    def test_two_equal_readings_of_a_slow_channel_are_not_frozen(self) -> None:
        t_ns = np.arange(60) * 1_000_000_000
        force = np.repeat(np.arange(30.0) + 1.0, 2)
        channels = {"force_x_N": (t_ns, force), "speed_x_m_s": (t_ns, np.arange(60.0) ** 2)}
        assert RawSignals(channels, None, 60.0).longest_frozen_duration_s == 0.0

    def test_single_readings_at_the_extreme_are_noise_that_reaches_it(self) -> None:
        force = np.minimum(self.noisy(), 100.0)  # one in twenty
        found = self.signals(force)
        assert found.largest_clipped_fraction > 0.0
        assert found.clipped_spans["force_x_N"] == []


class TestStands:
    """An encoder reads exactly 0 at a stand; one that drops out reads 0 as well."""

    T_NS = np.arange(1000) * 10_000_000

    def stands(self, **speeds: np.ndarray) -> list[tuple[int, int]]:
        channels = {name: (self.T_NS, speed) for name, speed in speeds.items()}
        return RawSignals(channels, None, 10.0).standstill_spans

    def drive(self) -> np.ndarray:
        """Three seconds of stand, a start, a stop, and a stand again."""
        return 2.0 * np.clip(np.sin((np.arange(1000) - 300) / 150), 0.0, None)

    def test_a_speed_that_comes_to_zero_gradually_stands(self) -> None:
        assert self.stands(speed_x_m_s=self.drive())[0] == (0, 3_000_000_000)

    def test_a_speed_that_falls_to_zero_at_once_dropped_out(self) -> None:
        dropped = self.drive()
        dropped[500:600] = 0.0
        assert all(end < 5e9 or begin > 6e9 for begin, end in self.stands(speed_x_m_s=dropped))

    def test_the_machine_stands_where_both_sides_do(self) -> None:
        sides = {"speed_left_m_s": self.drive(), "speed_right_m_s": self.drive() + 1.0}
        assert self.stands(**sides) == []

    @pytest.mark.heavy
    def test_an_encoder_that_reads_zero_at_a_stand_withholds_nothing(self, tmp_path: Path) -> None:
        speed, acc = DRIVE["v"], DRIVE["a"]
        noise = np.random.default_rng(1).normal(0.0, 0.05, acc.size)
        car = Car(DRIVE["t"], DRIVE["F"], np.where(np.abs(speed) < 0.03, 0.0, speed), acc + noise)
        found = car.replayed(tmp_path)
        assert "frozen" not in set(found.run.frames["findings"]["cause"])
        assert found.check("frozen_s").passed
