"""Read reference masses in digital calibration certificates (DKD-E 7-2 for weights, and others).

A list of values has the names of its weights (in a `si:labelXMLList`, or in a `dcc:charsXMLList` or
`dcc:noQuantity` beside it); otherwise it must have as many values as its result has items, in the
order of the items.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from estimators.errors import EvidenceError, format_count
from recordings.dcc.dcc_document import DCC, SI, read_leaf_text
from recordings.dcc.dcc_limits import LIMITS
from recordings.dcc.dcc_quantity import (
    ASK_FOR_CORRECTION,
    MassValue,
    find_length_of_list_quantity,
    read_blank_separated_texts,
    read_mass_and_standard_u_kg,
)

if TYPE_CHECKING:
    from lxml.etree import _Element  # pyright: ignore[reportPrivateUsage]

_ASK_FOR_NAMES: Final = (
    "ask the laboratory for one that names them, or state the masses by value_kg and u_kg"
)

#: An item, and the names by which a certificate may refer to it.
NamedItem = tuple["_Element", Sequence[str]]
#: Kinds (refType) of quantities that are the mass, the preferred one first. Weights are certified
#: by conventional mass; for steel, it differs from the mass by less than 1e-6.
_KINDS: Final = ("conventionalMass", "mass", "measuredValue")


@dataclass(frozen=True, slots=True)
class CertifiedMass:
    """Mass from a certificate.

    Attributes:
        item_id: XML id of the item, or its identification.
        value_kg: the mass.
        u_kg: standard uncertainty of the mass.
        certificate: unique identifier of the certificate.
        issuer: name of the laboratory.
    """

    item_id: str
    value_kg: float
    u_kg: float
    certificate: str
    issuer: str


def read_certified_masses(
    root: "_Element", item_id: str, certificate_name: str
) -> list[CertifiedMass]:
    """Read the masses of a certificate.

    Args:
        root: signed part of the certificate.
        item_id: id or identification of the item; "" for all.
        certificate_name: the certificate's name, for errors.

    Raises:
        EvidenceError: there is no such item, it has no or several masses, the unit, value or
            uncertainty is invalid, or an uncertainty has no coverage factor.
    """
    admin = root.find(f"{{{DCC}}}administrativeData")
    assert admin is not None
    items = admin.findall(f"{{{DCC}}}items/{{{DCC}}}item")
    named = [(each, _list_names_of_item(each)) for each in items]
    wanted = [(each, names) for each, names in named if not item_id or item_id in names]
    if not wanted or any(not names for _, names in wanted):
        choices = ", ".join(names[0] for _, names in named if names)[:400] or "none with an id"
        raise EvidenceError(f"{certificate_name}: has no item '{item_id}'; its items: {choices}")
    if item_id and len(wanted) > 1:
        raise EvidenceError(
            f"{certificate_name}: has {len(wanted)} items named '{item_id}'; {ASK_FOR_CORRECTION}"
        )
    core = admin.find(f"{{{DCC}}}coreData")
    assert core is not None
    certificate = read_leaf_text(core.find(f"{{{DCC}}}uniqueIdentifier")) or ""
    contact = f"{{{DCC}}}calibrationLaboratory/{{{DCC}}}contact/{{{DCC}}}name/{{{DCC}}}content"
    issuer = read_leaf_text(admin.find(contact)) or ""
    if not issuer:
        raise EvidenceError(
            f"{certificate_name}: does not name its laboratory; {ASK_FOR_CORRECTION}"
        )
    found: list[CertifiedMass] = []
    masses = _CertificateMasses(root, named, certificate_name)
    for element, names in wanted:
        value_kg, u_kg = masses.read_mass_and_u_kg(
            element, f"{certificate_name}, item '{names[0]}'"
        )
        found.append(CertifiedMass(item_id or names[0], value_kg, u_kg, certificate, issuer))
    return found


def _list_names_of_item(item: "_Element") -> list[str]:
    """List the names by which a certificate may refer to an item."""
    values = item.findall(f"{{{DCC}}}identifications/{{{DCC}}}identification/{{{DCC}}}value")
    names = [item.get("id"), *(read_leaf_text(value) for value in values)]
    return [name for name in names if name]


class _CertificateMasses:
    """Quantities of a certificate that may be masses, each with its item."""

    def __init__(self, root: "_Element", items: Sequence[NamedItem], error_label: str) -> None:
        self._items = items
        self._error_label = error_label
        self._quantities = list(iter_quantities_and_item_ids(root))
        self._weights: dict[_Element, list[_Element]] = {}

    def read_mass_and_u_kg(self, item: "_Element", item_label: str) -> MassValue:
        """Read value and standard uncertainty of the only quantity that is the item's mass."""
        for kind in _KINDS:
            chosen = [
                (quantity, place)
                for quantity, refers in self._quantities
                if kind in list_ref_types_of_quantity(quantity)
                and self._can_quantity_be_of_item(item, quantity, refers)
                for place in self._list_item_positions_in_quantity(item, quantity, refers)
            ]
            if len(chosen) > 1:
                raise EvidenceError(
                    f"{item_label}: has {len(chosen)} quantities of the kind '{kind}', so it is "
                    f"not clear which is its mass; {ASK_FOR_CORRECTION}"
                )
            if chosen:
                return read_mass_and_standard_u_kg(*chosen[0], item_label)
        kinds = sorted(
            {
                kind
                for quantity, refers in self._quantities
                if self._can_quantity_be_of_item(item, quantity, refers)
                for kind in list_ref_types_of_quantity(quantity)
            }
        )[: LIMITS.max_items]
        raise EvidenceError(
            f"{item_label}: none of its quantities has the refType of a mass "
            f"({', '.join(_KINDS)}), only {', '.join(kinds) or 'quantities without one'}; "
            f"{ASK_FOR_CORRECTION}"
        )

    def _can_quantity_be_of_item(
        self, item: "_Element", quantity: "_Element", item_ids: Sequence[str] | None
    ) -> bool:
        """Whether a quantity may belong to the item."""
        if item_ids is not None:
            return item.get("id") in item_ids
        return len(self._items) == 1 or quantity.find(f"{{{SI}}}realListXMLList") is not None

    def _list_item_positions_in_quantity(
        self, item: "_Element", quantity: "_Element", item_ids: Sequence[str] | None
    ) -> list[int | None]:
        """List the indices of the item in the quantity's list; None for a single value."""
        if find_length_of_list_quantity(quantity, self._error_label) is None:
            shared = [each for each, _ in self._items if each.get("id") in (item_ids or ())]
            if len(shared) > 1:
                raise EvidenceError(
                    f"{self._error_label}: has one mass for {len(shared)} items; "
                    f"{ASK_FOR_CORRECTION}"
                )
            return [None]
        if quantity not in self._weights:
            self._weights[quantity] = find_item_of_each_list_value(
                quantity, self._items, item_ids, self._error_label
            )
        weights = self._weights[quantity]
        return [place for place, weight in enumerate(weights) if weight is item]


def list_ref_types_of_quantity(quantity: "_Element") -> list[str]:
    """List the kinds of a quantity: its refTypes without prefixes."""
    return [name.rpartition("_")[2] for name in quantity.get("refType", "").split()]


def iter_quantities_and_item_ids(
    certificate: "_Element",
) -> Iterator[tuple["_Element", list[str] | None]]:
    """Yield the quantities of results with the ids of their items; None if none is named."""
    results = certificate.find(f"{{{DCC}}}measurementResults")
    assert results is not None
    for quantity in results.iterfind(f".//{{{DCC}}}results//{{{DCC}}}quantity"):
        own: list[str] | None = None
        place: _Element | None = quantity
        while place is not None and own is None:
            own = place.get("refId", "").split() or None
            place = place.getparent()
        yield quantity, own


def find_item_of_each_list_value(
    quantity: "_Element",
    items: Sequence[NamedItem],
    item_ids: Sequence[str] | None,
    certificate_name: str,
) -> list["_Element"]:
    """Find the item that each value of a list belongs to, in the order of the values.

    Args:
        quantity: quantity with a `si:realListXMLList`.
        items: items of the certificate.
        item_ids: ids that the result refers to (`refId`); None for a result on all items.
        certificate_name: the certificate's name, for errors.

    Raises:
        EvidenceError: the certificate does not state the items, or states them ambiguously.
    """
    count = find_length_of_list_quantity(quantity, certificate_name)
    assert count is not None
    scope = [
        (each, names) for each, names in items if item_ids is None or each.get("id") in item_ids
    ]
    by_name: list[_Element] | None = None
    for texts in _iter_lists_of_item_names(quantity, certificate_name):
        found = find_items_named_by_list(texts, scope, count, certificate_name)
        if found is not None and by_name is not None and found != by_name:
            raise EvidenceError(
                f"{certificate_name}: a list of masses has two lists of names that disagree; "
                f"{ASK_FOR_CORRECTION}"
            )
        by_name = found or by_name
    if by_name is not None:
        return by_name
    if len(scope) != count:
        raise EvidenceError(
            f"{certificate_name}: a result has {format_count(len(scope), 'weight')} but a list has "
            f"{format_count(count, 'value')} without names, so it is not clear which mass "
            f"belongs to which weight; {_ASK_FOR_NAMES}"
        )
    order = [each.get("id") for each, _ in scope]
    if item_ids is not None and [each for each in item_ids if each in order] != order:
        raise EvidenceError(
            f"{certificate_name}: a list of masses names no weights, and its refId has another "
            "order than the items, so it is not clear which mass belongs to which weight; "
            f"{_ASK_FOR_NAMES}"
        )
    return [each for each, _ in scope]


def _iter_lists_of_item_names(quantity: "_Element", certificate_name: str) -> Iterator[list[str]]:
    """Yield lists of texts that may name weights: labels of the list, and texts beside it."""
    values = quantity.find(f"{{{SI}}}realListXMLList")
    assert values is not None
    if values.find(f"{{{SI}}}labelXMLList") is not None:
        yield read_blank_separated_texts(values, "labelXMLList", certificate_name)
    parent = quantity.getparent()
    assert parent is not None
    for beside in parent.findall(f"{{{DCC}}}quantity"):
        for chars in beside.findall(f"{{{DCC}}}charsXMLList"):
            yield (read_leaf_text(chars) or "").split()
        # a text in several languages occurs several times
        for content in beside.findall(f"{{{DCC}}}noQuantity/{{{DCC}}}content"):
            yield (read_leaf_text(content) or "").split()


def find_items_named_by_list(
    texts: Sequence[str],
    candidate_items: Sequence[NamedItem],
    value_count: int,
    certificate_name: str,
) -> list["_Element"] | None:
    """Find the items named by a list of texts; None if it names none, as a list of classes does."""
    called: dict[str, list[_Element]] = {}
    for each, names in candidate_items:
        for name in set(names):
            called.setdefault(name, []).append(each)
    found = [called.get(text, []) for text in texts]
    if not any(found):
        return None
    for text, items in zip(texts, found, strict=True):
        if len(items) != 1:
            raise EvidenceError(
                f"{certificate_name}: a list of names beside a list of masses has '{text[:40]}', "
                f"which is the name of {len(items)} items of that result; {ASK_FOR_CORRECTION}"
            )
    weights = [items[0] for items in found]
    if len(weights) != value_count:
        raise EvidenceError(
            f"{certificate_name}: a list of masses has {value_count} values but "
            f"{len(weights)} names; {ASK_FOR_CORRECTION}"
        )
    if len(set(weights)) != value_count:
        raise EvidenceError(
            f"{certificate_name}: a list of {value_count} masses names a weight twice; "
            f"{ASK_FOR_CORRECTION}"
        )
    return weights
