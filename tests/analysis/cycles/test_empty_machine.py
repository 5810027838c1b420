"""A weighbridge ticket of the empty machine tells the scale of payloads.

The sledge weighs 100 kg and hauls five loads; its force sensor is wrong by a factor that no one
knows.
"""

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import polars as pl
import pytest

from analysis.model.machine_body import Body
from analysis.model.run_record import Run
from analysis.weighing.empty_mass_datum import list_notes_on_outdated_tickets
from analysis.weighing.fuel_on_board import FuelOnBoard
from estimators.errors import MachineError
from replay import load_machine
from replay.logs.log_formats import open_log
from replay.machines.machine_file import find_time_axis_of_machine
from replay.pipeline import run
from tests.replay.sledge import MACHINE
from tests.replay.sledge_shift import EMPTY_KG, PAYLOADS_KG, sledge_shift
from tests.twins import mark_slow_after

TICKET = "machine.empty_mass_u_kg=0.3"
KNOWN = "machine.force_gain_u=0.01"


@cache
def replayed(gain: float, *overrides: str) -> Run:
    """The shift with a force that is too large by a factor."""
    with TemporaryDirectory() as name:
        machine, log = Path(name) / "sledge.toml", Path(name) / "shift.csv"
        machine.write_text(MACHINE)
        sledge_shift().write_csv(log)
        scaled = f"channels.force_x_N.scale={gain}"
        known = load_machine(machine, [scaled, *overrides])
        with open_log(log, time=find_time_axis_of_machine(known)) as opened:
            return run(opened, known)


def payloads(made: Run) -> list[float]:
    return made.frames["cycles"]["payload_kg"].to_list()


def summary(made: Run):
    return made.frames["shift"].row(0, named=True)


@pytest.mark.parametrize("gain", mark_slow_after(1, [1.1, 0.9]))
class TestAGainThatNoOneKnows:
    @pytest.mark.heavy
    def test_leaves_payloads_as_they_are_with_a_ticket(self, gain: float):
        right = payloads(replayed(1.0, TICKET))
        assert payloads(replayed(gain, TICKET)) == pytest.approx(right, rel=1e-3)
        assert right == pytest.approx(PAYLOADS_KG, rel=0.02)

    @pytest.mark.heavy
    def test_is_in_payloads_without_one(self, gain: float):
        right = [gain * each for each in payloads(replayed(1.0))]
        assert payloads(replayed(gain)) == pytest.approx(right, rel=1e-3)

    @pytest.mark.heavy
    def test_is_found_with_its_uncertainty(self, gain: float):
        found = summary(replayed(gain, TICKET))
        assert abs(found["gain_1"] - gain) < 3.0 * found["gain_u_1"]
        assert found["gain_u_1"] < 0.04

    @pytest.mark.heavy
    def test_leaves_payloads_of_loads_beside_those_of_the_log_alone(self, gain: float):
        span = ("settings.loads.empty_from_s=0", "settings.loads.empty_to_s=20")
        right = replayed(1.0, TICKET, *span).frames["loads"]
        found = replayed(gain, TICKET, *span).frames["loads"]
        for name, factor in (("payload_kg", 1.0), ("own_payload_kg", gain)):
            expected = [factor * each for each in right[name]]
            assert found[name].to_list() == pytest.approx(expected, rel=1e-3, abs=0.05)


class TestWhatTellsTheScale:
    @pytest.mark.heavy
    def test_nothing_where_the_machine_file_states_neither(self):
        found = summary(replayed(1.0))
        assert (found["scale_from"], found["scale_unknown"]) == ("", "force_gain")
        assert found["gain_1"] is None

    def test_the_ticket_where_it_has_an_uncertainty(self):
        found = summary(replayed(1.0, TICKET))
        assert (found["scale_from"], found["scale_unknown"]) == ("empty machine", "")

    def test_the_machine_file_where_it_knows_its_gain(self):
        found = summary(replayed(1.0, KNOWN))
        assert (found["scale_from"], found["scale_unknown"]) == ("machine file", "")


class TestUncertainty:
    @pytest.mark.heavy
    @pytest.mark.parametrize("ticket_kg", mark_slow_after(2, [0.1, 100.0, 1.0, 10.0]))
    def test_is_never_wider_for_a_ticket(self, ticket_kg: float):
        alone = summary(replayed(1.0, KNOWN))
        both = summary(replayed(1.0, KNOWN, f"machine.empty_mass_u_kg={ticket_kg}"))
        assert both["payload_u_kg"] <= alone["payload_u_kg"] * (1.0 + 1e-9)

    @pytest.mark.heavy
    def test_of_the_ticket_is_a_share_of_the_tonnes(self):
        exact, rough = (
            summary(replayed(1.0, f"machine.empty_mass_u_kg={u_kg}")) for u_kg in (0.0, 2.0)
        )
        added = np.sqrt(rough["payload_u_kg"] ** 2 - exact["payload_u_kg"] ** 2)
        assert added == pytest.approx(2.0 / EMPTY_KG * sum(PAYLOADS_KG), rel=0.03)

    @pytest.mark.heavy
    def test_a_wrong_ticket_is_in_the_payloads_as_it_is_in_their_uncertainty(self):
        right, wrong = replayed(1.0, TICKET), replayed(1.0, TICKET, "machine.empty_mass_kg=100.3")
        ratio = summary(wrong)["payload_kg"] / summary(right)["payload_kg"]
        assert ratio == pytest.approx(1.003, abs=1e-4)

    @pytest.mark.heavy
    def test_another_machine_s_ticket_is_said_and_not_absorbed(self):
        found = replayed(1.0, TICKET, KNOWN, "machine.empty_mass_kg=120.0").frames["cycles"]
        assert found["payload_kg"].null_count() == found.height
        assert found["withheld_for"].str.contains("negative_payload").all()


class TestFuelOnBoard:
    """The ticket was written with 5 L in the tank, and the log begins with 10."""

    LIGHTER = "machine.empty_mass_kg=96.0"
    TANK = (
        "machine.fuel.empty_mass_L=5",
        "machine.fuel.begin_L=10",
        "machine.fuel.density_kg_L=0.8",
    )

    @pytest.mark.heavy
    def test_a_ticket_of_a_tank_less_full_is_that_of_the_log_with_the_fuel(self):
        right = replayed(1.1, TICKET)
        found = replayed(1.1, TICKET, self.LIGHTER, *self.TANK)
        assert payloads(found) == pytest.approx(payloads(right), rel=1e-3)
        assert summary(found)["gain_1"] == pytest.approx(summary(right)["gain_1"], rel=1e-3)

    @pytest.mark.heavy
    def test_what_is_burnt_is_gone(self):
        # at a steady rate half of it is burnt when the empty passes are weighed on average
        hours = summary(replayed(1.1, TICKET))["duration_s"] / 3600.0
        rate = f"machine.fuel.rate_L_h={4.0 / hours}"
        none, burns = (
            summary(replayed(1.1, TICKET, *self.TANK, *more))["gain_1"] for more in ((), (rate,))
        )
        assert none / burns == pytest.approx(1.0 - 0.8 * 2.0 / (EMPTY_KG + 4.0), rel=0.004)

    @pytest.mark.heavy
    def test_litres_that_are_not_known_are_in_the_tonnes(self):
        exact, rough = (
            summary(replayed(1.0, TICKET, self.LIGHTER, *self.TANK, f"machine.fuel.u_L={u_L}"))
            for u_L in (0.0, 3.0)
        )
        added = np.sqrt(rough["payload_u_kg"] ** 2 - exact["payload_u_kg"] ** 2)
        assert added == pytest.approx(0.8 * 3.0 / EMPTY_KG * sum(PAYLOADS_KG), rel=0.05)


def test_a_gap_in_the_rate_burns_the_mean():
    body = Body.model_validate({"name": "x", "fuel": {"empty_mass_L": 0, "begin_L": 20}})
    rate = [10.0, None, 10.0, 10.0]
    hours = pl.DataFrame({"t_ns": [0, 1, 2, 3], "fuel_rate_L_h": rate}).with_columns(
        pl.col("t_ns") * 3600 * 10**9
    )
    fuel = FuelOnBoard.integrate_fuel_rate(body, hours)
    assert fuel is not None
    mass_kg, u_kg = fuel.estimate_fuel_mass_beyond_ticket_and_u_kg(
        hours["t_ns"].to_numpy()[[0, 2]], np.array([0.5, 0.5])
    )
    assert mass_kg == pytest.approx(0.8325 * (20.0 - 10.0))
    # a tenth of what is burnt, and a hundredth of the density
    assert u_kg == pytest.approx(0.8325 * np.hypot(0.1 * 10.0, 0.01 * 10.0))


def test_a_ticket_with_another_attachment_is_refused():
    with pytest.raises(MachineError, match=r"is with attachment 'fork'.* carries 'bucket'"):
        load_machine(
            "cat262c.toml",
            ["machine.empty_mass_attachment='fork'", "machine.attachment='bucket'"],
        )


@pytest.mark.parametrize(
    ("day", "said"),
    [
        ("2023-11-14", "was weighed on 2023-11-14, 3 days before this log"),
        ("2023-11-18", "was weighed on 2023-11-18, 1 day after this log"),
        ("2023-11-17", None),
    ],
)
def test_a_ticket_of_another_day_says_how_far_apart_they_are(day: str, said: str | None):
    # Friday evening of Greenwich is still Friday in Santiago
    start_ns = 1_700_265_600 * 10**9
    body = Body.model_validate(
        {
            "name": "sledge",
            "empty_mass_kg": 100.0,
            "empty_mass_u_kg": 0.3,
            "empty_mass_day": day,
            "timezone": "America/Santiago",
        }
    )
    notes = list_notes_on_outdated_tickets(body, start_ns)
    assert [said in note for note in notes] == [True] if said else not notes


def test_a_log_without_a_clock_has_no_day_to_compare():
    body = Body.model_validate(
        {
            "name": "sledge",
            "empty_mass_kg": 100.0,
            "empty_mass_u_kg": 0.3,
            "empty_mass_day": "2023-11-14",
        }
    )
    assert not list_notes_on_outdated_tickets(body, 5 * 10**9)


@pytest.mark.heavy
def test_the_day_of_a_ticket_is_kept_with_the_run():
    made = replayed(1.0, TICKET, "machine.empty_mass_day=2023-11-14")
    assert '"empty_mass_day":"2023-11-14"' in made.provenance.model_dump_json()
