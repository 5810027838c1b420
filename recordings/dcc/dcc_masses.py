"""Reference masses in digital calibration certificates (DKD-E 7-2 for weights, and others).

A list names its weights (`si:labelXMLList`, or a `dcc:charsXMLList` or `dcc:noQuantity` beside it);
otherwise it must have as many values as its result has items, in the items' order.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from estimators.errors import EvidenceError
from recordings.dcc.dcc_document import DCC, SI, read_leaf_text
from recordings.dcc.dcc_limits import LIMITS
from recordings.dcc.dcc_quantity import find_list_length, read_list_texts, read_value_and_u_kg

if TYPE_CHECKING:
    from lxml.etree import _Element  # pyright: ignore[reportPrivateUsage]

_REMEDY: Final = (
    "ask the laboratory for one that names them, or state the masses by value_kg and u_kg"
)

#: An item with all that it may be called by.
NamedItem = tuple["_Element", Sequence[str]]
#: What a quantity that is the mass calls itself, the best first. Conventional mass is what weights
#: are certified in; of steel it differs from the mass by less than 1e-6.
_KINDS: Final = ("conventionalMass", "mass", "measuredValue")


@dataclass(frozen=True, slots=True)
class CertifiedMass:
    """Mass from a certificate.

    Attributes:
        item_id: xml id of the item, or its identification.
        value_kg: the mass.
        u_kg: standard uncertainty.
        certificate: unique identifier of the certificate.
        issuer: name of the laboratory.
    """

    item_id: str
    value_kg: float
    u_kg: float
    certificate: str
    issuer: str


def read_certified_masses(root: "_Element", item: str, what: str) -> list[CertifiedMass]:
    """Read the masses of a certificate.

    Args:
        root: signed part of the certificate.
        item: id or identification of the item; "" for all.
        what: the certificate's name, for errors.

    Raises:
        EvidenceError: no such item, no or several masses of it, another unit, a value or an invalid
            uncertainty, or an uncertainty without its coverage factor.
    """
    admin = root.find(f"{{{DCC}}}administrativeData")
    assert admin is not None
    items = admin.findall(f"{{{DCC}}}items/{{{DCC}}}item")
    named = [(each, _list_item_names(each)) for each in items]
    wanted = [(each, names) for each, names in named if not item or item in names]
    if not wanted or any(not names for _, names in wanted):
        choices = ", ".join(names[0] for _, names in named if names)[:400] or "none with an id"
        raise EvidenceError(f"{what}: has no item '{item}'; its items: {choices}")
    if item and len(wanted) > 1:
        raise EvidenceError(f"{what}: has {len(wanted)} items named '{item}'")
    core = admin.find(f"{{{DCC}}}coreData")
    assert core is not None
    certificate = read_leaf_text(core.find(f"{{{DCC}}}uniqueIdentifier")) or ""
    contact = f"{{{DCC}}}calibrationLaboratory/{{{DCC}}}contact/{{{DCC}}}name/{{{DCC}}}content"
    issuer = read_leaf_text(admin.find(contact)) or ""
    if not issuer:
        raise EvidenceError(f"{what}: does not name its laboratory")
    found: list[CertifiedMass] = []
    masses = _CertificateMasses(root, named, what)
    for element, names in wanted:
        value_kg, u_kg = masses.read_mass_and_u_kg(element, f"{what}, item '{names[0]}'")
        found.append(CertifiedMass(item or names[0], value_kg, u_kg, certificate, issuer))
    return found


def _list_item_names(item: "_Element") -> list[str]:
    """Names by which a certificate may refer to an item."""
    values = item.findall(f"{{{DCC}}}identifications/{{{DCC}}}identification/{{{DCC}}}value")
    names = [item.get("id"), *(read_leaf_text(value) for value in values)]
    return [name for name in names if name]


class _CertificateMasses:
    """Quantities of a certificate that may be masses, each with its item."""

    def __init__(self, root: "_Element", items: Sequence[NamedItem], what: str) -> None:
        self._items = items
        self._what = what
        self._quantities = list(iter_quantities(root))
        self._weights: dict[_Element, list[_Element]] = {}

    def read_mass_and_u_kg(self, item: "_Element", what: str) -> tuple[float, float]:
        """Value and standard uncertainty of the only quantity that is the item's mass."""
        for kind in _KINDS:
            chosen = [
                (quantity, place)
                for quantity, refers in self._quantities
                if kind in list_quantity_kinds(quantity)
                and self._may_quantity_be_of_item(item, quantity, refers)
                for place in self._positions_in_list(item, quantity, refers)
            ]
            if len(chosen) > 1:
                raise EvidenceError(f"{what}: has {len(chosen)} quantities of the kind '{kind}'")
            if chosen:
                return read_value_and_u_kg(*chosen[0], what)
        kinds = sorted(
            {
                kind
                for quantity, refers in self._quantities
                if self._may_quantity_be_of_item(item, quantity, refers)
                for kind in list_quantity_kinds(quantity)
            }
        )[: LIMITS.max_items]
        raise EvidenceError(
            f"{what}: none of its quantities has the refType of a mass ({', '.join(_KINDS)}); it "
            f"has {'only ' + ', '.join(kinds) if kinds else 'none at all'}"
        )

    def _may_quantity_be_of_item(
        self, item: "_Element", quantity: "_Element", refers: Sequence[str] | None
    ) -> bool:
        """Whether a quantity may belong to the item."""
        if refers is not None:
            return item.get("id") in refers
        return len(self._items) == 1 or quantity.find(f"{{{SI}}}realListXMLList") is not None

    def _positions_in_list(
        self, item: "_Element", quantity: "_Element", refers: Sequence[str] | None
    ) -> list[int | None]:
        """Positions of the item in the quantity's list; None for a single value of the item."""
        if find_list_length(quantity, self._what) is None:
            shared = [each for each, _ in self._items if each.get("id") in (refers or ())]
            if len(shared) > 1:
                raise EvidenceError(f"{self._what}: has one mass for {len(shared)} items")
            return [None]
        if quantity not in self._weights:
            self._weights[quantity] = match_weights_to_list_values(
                quantity, self._items, refers, self._what
            )
        weights = self._weights[quantity]
        return [place for place, weight in enumerate(weights) if weight is item]


def list_quantity_kinds(quantity: "_Element") -> list[str]:
    """Kinds of a quantity: its refTypes without prefixes."""
    return [name.rpartition("_")[2] for name in quantity.get("refType", "").split()]


def iter_quantities(root: "_Element") -> Iterator[tuple["_Element", list[str] | None]]:
    """Yield the quantities of results with the ids of their items; None if none is named."""
    results = root.find(f"{{{DCC}}}measurementResults")
    assert results is not None
    for quantity in results.iterfind(f".//{{{DCC}}}results//{{{DCC}}}quantity"):
        own: list[str] | None = None
        place: _Element | None = quantity
        while place is not None and own is None:
            own = place.get("refId", "").split() or None
            place = place.getparent()
        yield quantity, own


def match_weights_to_list_values(
    quantity: "_Element", items: Sequence[NamedItem], item_ids: Sequence[str] | None, what: str
) -> list["_Element"]:
    """Items that the values of a list belong to, in the order of the values.

    Args:
        quantity: quantity with a `si:realListXMLList`.
        items: items of the certificate.
        item_ids: ids that the result refers to (`refId`); None for a result on all items.
        what: the certificate's name, for errors.

    Raises:
        EvidenceError: the certificate does not state it, or states it ambiguously.
    """
    count = find_list_length(quantity, what)
    assert count is not None
    scope = [
        (each, names) for each, names in items if item_ids is None or each.get("id") in item_ids
    ]
    by_name: list[_Element] | None = None
    for texts in _iter_weight_name_lists(quantity, what):
        found = find_named_items(texts, scope, count, what)
        if found is not None and by_name is not None and found != by_name:
            raise EvidenceError(f"{what}: a list of masses has two lists of names that disagree")
        by_name = found or by_name
    if by_name is not None:
        return by_name
    if len(scope) != count:
        raise EvidenceError(
            f"{what}: a list of masses names no weights, and has {count} values for a result "
            f"whose number of items is {len(scope)}, so it is not clear which mass belongs to "
            f"which weight; {_REMEDY}"
        )
    order = [each.get("id") for each, _ in scope]
    if item_ids is not None and [each for each in item_ids if each in order] != order:
        raise EvidenceError(
            f"{what}: a list of masses names no weights, and its refId has another order than the "
            f"items, so it is not clear which mass belongs to which weight; {_REMEDY}"
        )
    return [each for each, _ in scope]


def _iter_weight_name_lists(quantity: "_Element", what: str) -> Iterator[list[str]]:
    """Yield lists that may name weights: labels of the list, and texts next to it."""
    values = quantity.find(f"{{{SI}}}realListXMLList")
    assert values is not None
    if values.find(f"{{{SI}}}labelXMLList") is not None:
        yield read_list_texts(values, "labelXMLList", what)
    parent = quantity.getparent()
    assert parent is not None
    for beside in parent.findall(f"{{{DCC}}}quantity"):
        for chars in beside.findall(f"{{{DCC}}}charsXMLList"):
            yield (read_leaf_text(chars) or "").split()
        # a text in several languages is said several times
        for content in beside.findall(f"{{{DCC}}}noQuantity/{{{DCC}}}content"):
            yield (read_leaf_text(content) or "").split()


def find_named_items(
    texts: Sequence[str], scope: Sequence[NamedItem], count: int, what: str
) -> list["_Element"] | None:
    """Items named by a list of texts; None if it names none, such as a list of classes."""
    called: dict[str, list[_Element]] = {}
    for each, names in scope:
        for name in set(names):
            called.setdefault(name, []).append(each)
    found = [called.get(text, []) for text in texts]
    if not any(found):
        return None
    for text, items in zip(texts, found, strict=True):
        if len(items) != 1:
            raise EvidenceError(
                f"{what}: a list of names beside a list of masses has '{text[:40]}', which is the "
                f"name of {len(items)} items of that result"
            )
    weights = [items[0] for items in found]
    if len(weights) != count:
        raise EvidenceError(
            f"{what}: a list of masses has {count} values, and the number of its names is "
            f"{len(weights)}"
        )
    if len(set(weights)) != count:
        raise EvidenceError(f"{what}: a list of {count} masses names a weight twice")
    return weights
