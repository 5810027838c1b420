"""Quantities of certificates in D-SI: masses with uncertainty are read, reals are written."""

import math
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from estimators.errors import EvidenceError
from recordings.dcc.dcc_document import SI, read_leaf_text
from recordings.dcc.dcc_limits import LIMITS

if TYPE_CHECKING:
    from lxml.etree import _Element  # pyright: ignore[reportPrivateUsage]

#: Kilograms of each D-SI unit of mass that is read.
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

    def make_element_name(self, name: str) -> str:
        """Name of an element, with the suffix that lists have."""
        return f"{name}XMLList" if self.count else name

    def read_entry_texts(self, parent: "_Element", name: str, what: str) -> list[str]:
        """Texts of an element: one, or in lists one for all entries or one per entry.

        Raises:
            EvidenceError: none, or another number than that.
        """
        if not self.count:
            return [read_required_text(parent, name, what)]
        texts = read_list_texts(parent, self.make_element_name(name), what)
        if len(texts) not in (1, self.count):
            raise EvidenceError(
                f"{what}: its si:{self.make_element_name(name)} has {len(texts)} entries for "
                f"{self.count} values, neither one for all nor one for each"
            )
        return texts

    def read_entry_number(self, parent: "_Element", name: str, what: str) -> float:
        """Number of this entry; all numbers of a list must be valid."""
        texts = self.read_entry_texts(parent, name, what)
        numbers = [_parse_number(text, self.make_element_name(name), what) for text in texts]
        return numbers[self.place if len(numbers) > 1 else 0]


def find_list_length(quantity: "_Element", what: str) -> int | None:
    """Number of values of a list quantity; None for a si:real.

    Raises:
        EvidenceError: neither, or both, or too long a list.
    """
    reals = quantity.findall(f"{{{SI}}}real")
    lists = quantity.findall(f"{{{SI}}}realListXMLList")
    if len(reals) + len(lists) != 1:
        raise EvidenceError(f"{what}: its mass is not one si:real or one si:realListXMLList")
    if reals:
        return None
    count = len(read_list_texts(lists[0], "valueXMLList", what))
    if count > LIMITS.max_values:
        raise EvidenceError(f"{what}: its list has {count} values, more than {LIMITS.max_values}")
    return count


def read_value_and_u_kg(
    quantity: "_Element", list_index: int | None, what: str
) -> tuple[float, float]:
    """Value and standard uncertainty of a mass.

    Args:
        quantity: quantity of the mass.
        list_index: index of the value in the quantity's list; None for a single value.
        what: names of certificate and item, for errors.

    Raises:
        EvidenceError: not a mass, not with one uncertainty, or numbers that no weight has.
    """
    count = find_list_length(quantity, what)
    name = "real" if count is None else "realListXMLList"
    element = quantity.find(f"{{{SI}}}{name}")
    assert element is not None
    value = DsiValue(element, list_index or 0, count or 0)
    units = value.read_entry_texts(element, "unit", what)
    strange = next((unit for unit in units if unit not in _UNITS_KG), None)
    if strange is not None:
        raise EvidenceError(
            f"{what}: its mass has the unit '{strange[:40]}'; use one of {', '.join(_UNITS_KG)}"
        )
    unit_kg = _UNITS_KG[units[value.place if len(units) > 1 else 0]]
    value_kg = value.read_entry_number(element, "value", what) * unit_kg
    u_kg = _read_standard_uncertainty(value, what, several_units=len(set(units)) > 1) * unit_kg
    if not 0.0 < value_kg <= LIMITS.weight_max_kg:
        raise EvidenceError(f"{what}: {value_kg:g} kg is not a possible mass of a weight")
    if not 0.0 < u_kg <= LIMITS.weight_max_u_1 * value_kg:
        raise EvidenceError(
            f"{what}: a standard uncertainty of {u_kg:g} kg is not possible for {value_kg:g} kg"
        )
    return value_kg, u_kg


def _read_standard_uncertainty(value: DsiValue, what: str, *, several_units: bool) -> float:
    """Standard uncertainty in the unit of the value."""
    expanded = list(value.element.iter(f"{{{SI}}}{value.make_element_name('expandedUnc')}"))
    interval = list(value.element.iter(f"{{{SI}}}{value.make_element_name('coverageInterval')}"))
    if len(expanded) + len(interval) != 1:
        raise EvidenceError(f"{what}: has {len(expanded) + len(interval)} uncertainties, not one")
    inside, name = (interval[0], "standardUnc") if interval else (expanded[0], "uncertainty")
    if several_units and len(value.read_entry_texts(inside, name, what)) == 1:
        raise EvidenceError(f"{what}: has one uncertainty for values in several units")
    if interval:
        return value.read_entry_number(inside, name, what)
    k = value.read_entry_number(inside, "coverageFactor", what)
    if not 1.0 <= k <= LIMITS.max_coverage_factor:
        raise EvidenceError(f"{what}: {k:g} is not a coverage factor")
    p = value.read_entry_number(inside, "coverageProbability", what)
    if not 0.5 <= p < 1.0:
        raise EvidenceError(
            f"{what}: {p:g} is not a coverage probability of an expanded uncertainty"
        )
    return value.read_entry_number(inside, name, what) / k


def read_required_text(parent: "_Element", name: str, what: str) -> str:
    """Text of the only child with a name.

    Raises:
        EvidenceError: there is none, or several.
    """
    found = parent.findall(f"{{{SI}}}{name}")
    text = read_leaf_text(found[0]) if len(found) == 1 else None
    if not text:
        raise EvidenceError(f"{what}: its {parent.tag.rpartition('}')[2]} has no single si:{name}")
    return text


def read_list_texts(parent: "_Element", name: str, what: str) -> list[str]:
    """Entries of the only child with a name.

    Raises:
        EvidenceError: there is no such child, or several.
    """
    return read_required_text(parent, name, what).split()


def _parse_number(text: str, name: str, what: str) -> float:
    if len(text) > LIMITS.number_characters or not _NUMBER.fullmatch(text):
        raise EvidenceError(f"{what}: its si:{name} '{text[:40]}' is not a decimal number")
    value = float(text)
    if not math.isfinite(value):
        raise EvidenceError(f"{what}: its si:{name} '{text[:40]}' is not finite")
    return value


def format_decimal(value: float) -> str:
    """Number in D-SI's notation with all digits."""
    return repr(float(value))


def format_coverage_factor(value: float) -> str:
    """Coverage factor or probability in D-SI's notation, without an exponent."""
    return f"{value:.12f}".rstrip("0").ljust(3, "0")


def add_real_quantity(
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
    add_child(real, "value", format_decimal(value))
    add_child(real, "unit", unit)
    if expanded_uncertainty is not None:
        u, k, p = expanded_uncertainty
        said = add_child(real, "expandedUnc")
        add_child(said, "uncertainty", format_decimal(u))
        add_child(said, "coverageFactor", format_coverage_factor(k))
        add_child(said, "coverageProbability", format_coverage_factor(p))
    if interval is not None:
        u, low, high, p = interval
        said = add_child(real, "coverageInterval")
        add_child(said, "standardUnc", format_decimal(u))
        add_child(said, "intervalMin", format_decimal(low))
        add_child(said, "intervalMax", format_decimal(high))
        add_child(said, "coverageProbability", format_coverage_factor(p))
