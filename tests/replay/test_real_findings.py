"""Findings of logs made by others, as they are and with a fault put into their machine file."""

from collections.abc import Sequence
from pathlib import Path

import polars as pl
import pytest

from benchmarks.real_faults import FAULTS, trial
from replay import load_machine, open_log, run
from replay.machines.machine_file import find_time_axis_of_machine
from tests.twins import mark_slow_after

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


@pytest.fixture(scope="session")
def data(shared_data: Path) -> Path:
    return shared_data


def findings(log: Path, machine_file: str, overrides: Sequence[str] = ()) -> pl.DataFrame:
    machine = load_machine(EXAMPLES / machine_file, overrides)
    with open_log(log, time=find_time_axis_of_machine(machine)) as opened:
        return run(opened, machine).frames["findings"]


class TestLinearAxis:
    """A published reference says 20.4 N of Coulomb friction, which a linear fit does not have."""

    def found(self, data: Path, *overrides: str) -> pl.DataFrame:
        return findings(data / "logs/linear_axis.csv", "linear_axis.toml", overrides)

    def test_with_the_friction_in_its_machine_file_nothing_is_found(self, data: Path) -> None:
        assert self.found(data).is_empty()

    def test_without_it_the_friction_is_the_only_finding(self, data: Path) -> None:
        found = self.found(data, "settings.forces.coulomb=false")
        assert found["cause"].to_list() == ["coulomb"]
        newtons = float(found["evidence"][0].split(" ")[0])
        assert newtons == pytest.approx(20.4, abs=2.0)

    @pytest.mark.parametrize(
        ("override", "cause"),
        [
            ("channels.force_x_N.scale=-1", "sign_flipped"),
            ("channels.force_x_N.delay_s=-0.02", "delay"),
        ],
    )
    def test_a_fault_in_its_machine_file_is_named(
        self, data: Path, override: str, cause: str
    ) -> None:
        assert cause in self.found(data, override)["cause"].to_list()[:2]


#: Name in the benchmark, size, where it must be named at the latest, and whether it is mended: a
#: log of fewer than four starts has no half to try a proposal on that it was not fitted to.
INJECTED = (
    ("force times {:g}", -1.0, 1, True),
    # mended, a force by the place could be, and the uncertainty would grow
    ("force {:g} ms late", 20.0, 1, False),
    ("force times {:g}", 0.001, 2, False),
    ("40 spikes of {:g} N", 200.0, 1, False),
    ("force frozen, 3 times {:g} s", 0.5, 1, False),
    ("force clipped at {:.0%}", 0.9, 1, False),
    ("3 gaps of {:g} s", 0.2, 1, False),
    ("force in steps of {:g} N", 10.0, 1, False),
    ("clock jumps by {:g} ms", 20.0, 1, False),
    # the same of the other column, the other sign or a smaller size
    ("position times {:g}", -1.0, 1, True),
    ("position times {:g}", 1000.0, 1, False),
    ("position in steps of {:g} m", 1e-3, 1, False),
    ("force {:g} ms early", 40.0, 1, False),
    ("force {:g} ms late", 5.0, 1, False),
    ("force {:g} ms early", 10.0, 1, False),
)
#: How many `make test` has, some seconds each: a sign, a delay, a unit and spikes.
FEW = 4


class TestFaultsPutIntoTheLinearAxis:
    """A small twin of the table in docs/explaining.md."""

    @pytest.mark.parametrize(("name", "size", "place", "mends"), mark_slow_after(FEW, INJECTED))
    def test_it_is_named_and_mended_where_a_machine_file_can(
        self, data: Path, name: str, size: float, place: int, mends: bool
    ) -> None:
        fault = next(each for each in FAULTS if each.name == name and size in each.sizes)
        logs = data / "logs"
        found = trial(fault, size, logs / "linear_axis.csv", logs / "linear_axis.bag")
        assert found.place is not None, found
        assert found.place <= place, found
        # without it the mass is 94.6 kg
        if mends:
            assert found.mended, found
            if "ms" in name:
                _, _, delay_s = found.mended[0].partition(" = ")
                assert abs(float(delay_s)) == pytest.approx(size / 1e3, abs=3e-3), found
            assert found.mended_kg == pytest.approx(94.6, abs=1.0), found
        else:
            assert not found.mended, found


class TestHusky:
    """Motor currents without a sign, and an IMU that shows little of the motion."""

    @pytest.mark.parametrize("machine_file", ["husky_imu.toml", "husky_wheels.toml"])
    def test_the_unsigned_current_is_named_first(self, data: Path, machine_file: str) -> None:
        found = findings(data / "logs/husky_asphalt.bag", machine_file)
        assert found["cause"][0] == "unsigned"
        assert found["severity"][0] == "withhold"

    def test_the_attenuation_of_the_imu_is_named(self, data: Path) -> None:
        found = findings(data / "logs/husky_asphalt.bag", "husky_imu.toml")
        assert "imu_low_passed" in found["cause"].to_list()
