"""Logs of two machines in one shift: the mass of the empty machine jumps."""

import numpy as np
import polars as pl

from analysis.cycles.empty_machine import find_machine_change_by_empty_mass

NS = 10**9
#: Two logs, of which the second begins after 1000 s.
BEGINS_NS = [0, 1000 * NS]


def starts(*masses_kg: float, from_s: float = 0.0, std_kg: float = 20.0) -> pl.DataFrame:
    """Manoeuvres of these masses, one every 30 s."""
    begin = [round((from_s + 30.0 * k) * NS) for k in range(len(masses_kg))]
    return pl.DataFrame(
        {
            "load_id": np.arange(len(masses_kg)),
            "start_t_ns": begin,
            "end_t_ns": [each + 4 * NS for each in begin],
            "mass_kg": list(masses_kg),
            "mass_std_kg": [std_kg] * len(masses_kg),
        }
    )


def shift(empty_kg: float, other_kg: float) -> pl.DataFrame:
    """Three hauls by one machine, and three by another."""
    one = starts(*[empty_kg, empty_kg + 900.0] * 3)
    return pl.concat([one, starts(*[other_kg, other_kg + 900.0] * 3, from_s=1000.0)])


def test_a_machine_half_as_heavy_again_is_another_one() -> None:
    found = find_machine_change_by_empty_mass(shift(3600.0, 5000.0), BEGINS_NS)
    assert found is not None
    assert found.log == 1
    said = found.make_warning_text("truck2.bag")
    assert "3,600 kg before truck2.bag and 5,000 kg from then on (+39%)" in said


def test_fuel_and_mud_are_no_other_machine() -> None:
    assert find_machine_change_by_empty_mass(shift(3600.0, 3750.0), BEGINS_NS) is None


def test_a_log_that_is_loaded_all_along_says_nothing_of_the_empty_machine() -> None:
    loaded = starts(*[4500.0] * 6, from_s=1000.0)
    hauls = starts(*[3600.0, 4500.0] * 3)
    assert find_machine_change_by_empty_mass(pl.concat([hauls, loaded]), BEGINS_NS) is None


def test_a_jump_within_one_log_is_a_load() -> None:
    assert find_machine_change_by_empty_mass(shift(3600.0, 5000.0), [0]) is None


def test_masses_that_are_hardly_known_do_not_jump() -> None:
    noisy = shift(3600.0, 5000.0).with_columns(mass_std_kg=pl.lit(400.0))
    assert find_machine_change_by_empty_mass(noisy, BEGINS_NS) is None


def test_a_shift_without_a_mass_has_no_jump() -> None:
    assert find_machine_change_by_empty_mass(starts(), BEGINS_NS) is None
