"""Any unit a person writes, as gain and offset to the column's SI unit."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from analysis.model.physical_units import (
    find_gain_and_offset_to_si,
    find_pint_unit_name,
    get_unit_registry,
)
from analysis.model.schema import CHANNEL_COLUMNS
from estimators.errors import MachineError


@pytest.mark.parametrize(
    ("unit", "si", "gain"),
    [
        ("km/h", "m/s", 1 / 3.6),
        ("deg/s", "rad/s", 0.017453292519943295),
        ("kN", "N", 1000.0),
        ("lbf*ft", "N·m", 1.3558179483314004),
        ("rpm", "rad/s", 0.10471975511965977),
        ("mm", "m", 0.001),
        ("g_0", "m/s²", 9.80665),
        ("deg", "rad", 0.017453292519943295),
        ("mph", "m/s", 0.44704),
    ],
)
def test_units_become_si(unit, si, gain):
    assert find_gain_and_offset_to_si(unit, si) == (pytest.approx(gain, rel=1e-12), 0.0)


@pytest.mark.parametrize(
    ("written", "si", "gain"),
    [
        ("ft/s^2", "m/s²", 0.3048),
        ("[ft/s²]", "m/s²", 0.3048),
        ("mm/s²", "m/s²", 0.001),
        ("cm/s²", "m/s²", 0.01),
        ("deg/s²", "rad/s²", 0.017453292519943295),
        ("in-lb", "N·m", 0.1129848290276167),
        ("ips", "m/s", 0.0254),
    ],
)
def test_units_become_si_as_people_write_them(written, si, gain):
    unit = find_pint_unit_name(written)
    assert unit is not None
    assert find_gain_and_offset_to_si(unit, si) == (pytest.approx(gain, rel=1e-12), 0.0)


def test_every_channels_own_unit_is_one_to_one():
    for column in CHANNEL_COLUMNS:
        assert find_gain_and_offset_to_si(column.unit, column.unit) == (1.0, 0.0), column.name


def test_a_unit_that_is_no_other_is_one_to_one_as_pint_has_it():
    """Pint is not asked: each is a unit of pint's, which gives the number back bit for bit."""
    units = {
        find_pint_unit_name(text)
        for text in ("N", "m/s", "m/s2", "rad/s", "Nm", "%", "°C", "t", "g")
    }
    for unit in {column.unit for column in CHANNEL_COLUMNS} | {*filter(None, units)}:
        spelt = unit.replace("·", "*").replace("²", "**2").replace("°", "degree")
        numbers = [
            get_unit_registry().Quantity(x, spelt).to(spelt).magnitude for x in (0.0, 1.0, 0.1)
        ]
        assert numbers == [0.0, 1.0, 0.1], unit
        assert find_gain_and_offset_to_si(spelt, unit) == (1.0, 0.0)


@pytest.mark.parametrize(("unit", "si"), [("m", "m/s"), ("kg", "N"), ("degC", "m"), ("", "rad/s²")])
def test_a_unit_of_another_dimension_is_an_error_that_names_both(unit, si):
    with pytest.raises(MachineError) as error:
        find_gain_and_offset_to_si(unit, si)
    assert str(error.value) == f"unit '{unit}' cannot be converted to {si}; correct the unit"


@pytest.mark.parametrize(
    "unit", ["furlogs", "m/", "(", "m/0", "**", "'", "m s )", "#", "[", "5 m/s", "é"]
)
def test_text_that_is_no_unit_is_an_error_with_examples(unit):
    with pytest.raises(MachineError) as error:
        find_gain_and_offset_to_si(unit, "m/s")
    assert str(error.value) == (f"no unit {unit!r}; write for example 'km/h', 'deg/s' or 'kN'")


@given(st.text("abkmsNrd/*^()+-. 10'\"[]{}#%\n\\", max_size=8))
def test_no_text_whatever_ends_in_a_traceback_or_a_second_line(unit):
    try:
        numbers = find_gain_and_offset_to_si(unit, "m/s")
    except MachineError as error:
        lines = str(error).splitlines()
    else:
        lines = [repr(numbers)]
        assert all(isinstance(number, float) for number in numbers)
    assert len(lines) == 1
