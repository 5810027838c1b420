"""Read masses with their uncertainties in D-SI from certificates, and write reals in D-SI."""

import math
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple

from estimators.errors import EvidenceError
from recordings.dcc.dcc_document import SI, read_leaf_text
from recordings.dcc.dcc_limits import LIMITS

if TYPE_CHECKING:
    from lxml.etree import _Element  # pyright: ignore[reportPrivateUsage]

#: Remedy for a certificate that the laboratory has to correct.
ASK_FOR_CORRECTION: Final = (
    "ask the laboratory for a corrected certificate, or state the masses by value_kg and u_kg"
)
#: Kilograms per D-SI unit of mass, for the units that are read.
_UNITS_KG: Final = {
    r"\kilogram": 1.0,
    r"\kilo\gram": 1.0,
    r"\gram": 1e-3,
    r"\milli\gram": 1e-6,
    r"\micro\gram": 1e-9,
    r"\mega\gram": 1e3,
    r"\tonne": 1e3,
}
_NUMBER: Final = re.compile(r"[-+]?(\d*\.\d+|\d+\.?\d*)([Ee][-+]?\d+)?")


@dataclass(frozen=True, slots=True)
class DsiValue:
    """Value of a quantity: a si:real, or an entry of a si:realListXMLList.

    Attributes:
        element: XML element of the si:real or the list.
        place: index of the entry in the list; 0 for a si:real.
        count: number of entries; 0 for a si:real.
    """

    element: "_Element"
    place: int = 0
    count: int = 0

    def make_dsi_element_name(self, base_name: str) -> str:
        """Make the name of an element, with the suffix `XMLList` in a list."""
        return f"{base_name}XMLList" if self.count else base_name

    def read_list_entry_texts(
        self, parent: "_Element", element_name: str, error_label: str
    ) -> list[str]:
        """Read the texts of an element: one; in a list, one for all entries or one per entry.

        Raises:
            EvidenceError: there is none, or another number of texts.
        """
        if not self.count:
            return [read_text_of_required_child(parent, element_name, error_label)]
        texts = read_blank_separated_texts(
            parent, self.make_dsi_element_name(element_name), error_label
        )
        if len(texts) not in (1, self.count):
            raise EvidenceError(
                f"{error_label}: its si:{self.make_dsi_element_name(element_name)} has "
                f"{len(texts)} entries for {self.count} values, neither one for all nor one for "
                f"each; {ASK_FOR_CORRECTION}"
            )
        return texts

    def read_number_of_list_entry(
        self, parent: "_Element", element_name: str, error_label: str
    ) -> float:
        """Read the number of this entry; all numbers of a list must be valid."""
        texts = self.read_list_entry_texts(parent, element_name, error_label)
        numbers = [
            _parse_finite_number(text, self.make_dsi_element_name(element_name), error_label)
            for text in texts
        ]
        return numbers[self.place if len(numbers) > 1 else 0]


def find_length_of_list_quantity(quantity: "_Element", error_label: str) -> int | None:
    """Find the number of values of a list quantity; None for a si:real.

    Raises:
        EvidenceError: the quantity has neither or both of them, or the list is too long.
    """
    reals = quantity.findall(f"{{{SI}}}real")
    lists = quantity.findall(f"{{{SI}}}realListXMLList")
    if len(reals) + len(lists) != 1:
        raise EvidenceError(
            f"{error_label}: its mass must be exactly one si:real or one si:realListXMLList; "
            f"{ASK_FOR_CORRECTION}"
        )
    if reals:
        return None
    count = len(read_blank_separated_texts(lists[0], "valueXMLList", error_label))
    if count > LIMITS.max_values:
        raise EvidenceError(
            f"{error_label}: its list has {count} values, but at most {LIMITS.max_values} are "
            f"read; {ASK_FOR_CORRECTION}"
        )
    return count


class MassValue(NamedTuple):
    """Mass with its standard uncertainty."""

    mass_kg: float
    u_kg: float


def read_mass_and_standard_u_kg(
    quantity: "_Element", list_index: int | None, error_label: str
) -> MassValue:
    """Read value and standard uncertainty of a mass.

    Args:
        quantity: quantity of the mass.
        list_index: index of the value in the quantity's list; None for a single value.
        error_label: names of certificate and item, for errors.

    Raises:
        EvidenceError: the quantity is not a mass, has no or several uncertainties, or numbers that
            no weight has.
    """
    count = find_length_of_list_quantity(quantity, error_label)
    name = "real" if count is None else "realListXMLList"
    element = quantity.find(f"{{{SI}}}{name}")
    assert element is not None
    value = DsiValue(element, list_index or 0, count or 0)
    units = value.read_list_entry_texts(element, "unit", error_label)
    strange = next((unit for unit in units if unit not in _UNITS_KG), None)
    if strange is not None:
        raise EvidenceError(
            f"{error_label}: its mass has the unit '{strange[:40]}'; use one of "
            f"{', '.join(_UNITS_KG)}"
        )
    unit_kg = _UNITS_KG[units[value.place if len(units) > 1 else 0]]
    value_kg = value.read_number_of_list_entry(element, "value", error_label) * unit_kg
    u_kg = (
        _read_standard_uncertainty(value, error_label, has_several_units=len(set(units)) > 1)
        * unit_kg
    )
    if not 0.0 < value_kg <= LIMITS.weight_max_kg:
        raise EvidenceError(
            f"{error_label}: {value_kg:g} kg is not a possible mass of a weight (above 0 and at "
            f"most {LIMITS.weight_max_kg:g} kg); {ASK_FOR_CORRECTION}"
        )
    if not 0.0 < u_kg <= LIMITS.weight_max_u_1 * value_kg:
        raise EvidenceError(
            f"{error_label}: a standard uncertainty of {u_kg:g} kg is not possible for "
            f"{value_kg:g} kg; {ASK_FOR_CORRECTION}"
        )
    return MassValue(value_kg, u_kg)


def _read_standard_uncertainty(
    dsi_value: DsiValue, error_label: str, *, has_several_units: bool
) -> float:
    """Read the standard uncertainty, in the unit of the value."""
    expanded = list(
        dsi_value.element.iter(f"{{{SI}}}{dsi_value.make_dsi_element_name('expandedUnc')}")
    )
    interval = list(
        dsi_value.element.iter(f"{{{SI}}}{dsi_value.make_dsi_element_name('coverageInterval')}")
    )
    if len(expanded) + len(interval) != 1:
        raise EvidenceError(
            f"{error_label}: has {len(expanded) + len(interval)} uncertainties, not one; "
            f"{ASK_FOR_CORRECTION}"
        )
    inside, name = (interval[0], "standardUnc") if interval else (expanded[0], "uncertainty")
    if has_several_units and len(dsi_value.read_list_entry_texts(inside, name, error_label)) == 1:
        raise EvidenceError(
            f"{error_label}: has one uncertainty for values in several units; {ASK_FOR_CORRECTION}"
        )
    if interval:
        return dsi_value.read_number_of_list_entry(inside, name, error_label)
    k = dsi_value.read_number_of_list_entry(inside, "coverageFactor", error_label)
    if not 1.0 <= k <= LIMITS.max_coverage_factor:
        raise EvidenceError(
            f"{error_label}: the coverage factor {k:g} is not from 1 to "
            f"{LIMITS.max_coverage_factor:g}; {ASK_FOR_CORRECTION}"
        )
    p = dsi_value.read_number_of_list_entry(inside, "coverageProbability", error_label)
    if not 0.5 <= p < 1.0:
        raise EvidenceError(
            f"{error_label}: the coverage probability {p:g} is not at least 0.5 and below 1; "
            f"{ASK_FOR_CORRECTION}"
        )
    return dsi_value.read_number_of_list_entry(inside, name, error_label) / k


def read_text_of_required_child(parent: "_Element", element_name: str, error_label: str) -> str:
    """Read the text of the only child with a name.

    Raises:
        EvidenceError: there is none, or several.
    """
    found = parent.findall(f"{{{SI}}}{element_name}")
    text = read_leaf_text(found[0]) if len(found) == 1 else None
    if not text:
        tag = parent.tag.rpartition("}")[2]
        raise EvidenceError(
            f"{error_label}: its {tag} must have exactly one si:{element_name}, with text; "
            f"{ASK_FOR_CORRECTION}"
        )
    return text


def read_blank_separated_texts(
    parent: "_Element", element_name: str, error_label: str
) -> list[str]:
    """Read the blank-separated texts of the only child with a name.

    Raises:
        EvidenceError: there is no such child, or several.
    """
    return read_text_of_required_child(parent, element_name, error_label).split()


def _parse_finite_number(text: str, element_name: str, error_label: str) -> float:
    if len(text) > LIMITS.number_characters or not _NUMBER.fullmatch(text):
        raise EvidenceError(
            f"{error_label}: its si:{element_name} '{text[:40]}' is not a decimal number; "
            f"{ASK_FOR_CORRECTION}"
        )
    value = float(text)
    if not math.isfinite(value):
        raise EvidenceError(
            f"{error_label}: its si:{element_name} '{text[:40]}' is not finite; "
            f"{ASK_FOR_CORRECTION}"
        )
    return value


def format_decimal_in_dsi_notation(value: float) -> str:
    """Format a number in D-SI's notation with all digits."""
    return repr(float(value))


def format_coverage_without_exponent(value: float) -> str:
    """Format a coverage factor or probability in D-SI's notation, without an exponent."""
    return f"{value:.12f}".rstrip("0").ljust(3, "0")


def add_dsi_real_element(
    parent: "_Element",
    value: float,
    unit: str,
    expanded_uncertainty: tuple[float, float, float] | None = None,
    interval: tuple[float, float, float, float] | None = None,
) -> None:
    """Add a D-SI real; `expanded_uncertainty` is U, k, p, and `interval` is u, min, max, p."""
    from lxml import etree

    def add_child(inside: "_Element", name: str, text: str | None = None) -> "_Element":
        made = etree.SubElement(inside, f"{{{SI}}}{name}")
        made.text = text
        return made

    real = add_child(parent, "real")
    add_child(real, "value", format_decimal_in_dsi_notation(value))
    add_child(real, "unit", unit)
    if expanded_uncertainty is not None:
        u, k, p = expanded_uncertainty
        said = add_child(real, "expandedUnc")
        add_child(said, "uncertainty", format_decimal_in_dsi_notation(u))
        add_child(said, "coverageFactor", format_coverage_without_exponent(k))
        add_child(said, "coverageProbability", format_coverage_without_exponent(p))
    if interval is not None:
        u, low, high, p = interval
        said = add_child(real, "coverageInterval")
        add_child(said, "standardUnc", format_decimal_in_dsi_notation(u))
        add_child(said, "intervalMin", format_decimal_in_dsi_notation(low))
        add_child(said, "intervalMax", format_decimal_in_dsi_notation(high))
        add_child(said, "coverageProbability", format_coverage_without_exponent(p))
