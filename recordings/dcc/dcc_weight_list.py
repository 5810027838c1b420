"""Which weight each value of a list is of.

A list names its weights (`si:labelXMLList`, or a `dcc:charsXMLList` or `dcc:noQuantity` beside it),
or it has as many values as there are items that its result is of, and then it has their order.
"""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Final

from estimators.errors import EvidenceError
from recordings.dcc.dcc_document import DCC, SI, leaf_text
from recordings.dcc.dcc_quantity import list_texts, value_count

if TYPE_CHECKING:
    from lxml.etree import _Element  # pyright: ignore[reportPrivateUsage]

_REMEDY: Final = (
    "ask the laboratory for one that names them, or state the masses by value_kg and u_kg"
)

#: An item with all that it may be called by.
NamedItem = tuple["_Element", Sequence[str]]


def weights_of_list(
    quantity: "_Element", items: Sequence[NamedItem], named_by: Sequence[str] | None, what: str
) -> list["_Element"]:
    """The items that the values of a list are of, in the order of the values.

    Args:
        quantity: has a `si:realListXMLList`.
        items: of the certificate.
        named_by: ids that the result refers to (`refId`); None of a result that is of all items.
        what: the certificate's name, for errors.

    Raises:
        EvidenceError: the certificate does not say which, or says it in two ways.
    """
    count = value_count(quantity, what)
    assert count is not None
    scope = [(each, names) for each, names in items if _is_of(each, named_by)]
    by_name: list[_Element] | None = None
    for texts in _name_lists(quantity, what):
        found = _named_items(texts, scope, count, what)
        if found is not None and by_name is not None and found != by_name:
            raise EvidenceError(f"{what}: two lists of names beside a list of masses disagree")
        by_name = found or by_name
    if by_name is not None:
        return by_name
    if len(scope) != count:
        raise EvidenceError(
            f"{what}: a list of masses names no weights, and has {count} values for a result whose "
            f"number of items is {len(scope)}, so which mass is whose is not said; {_REMEDY}"
        )
    order = [each.get("id") for each, _ in scope]
    if named_by is not None and [each for each in named_by if each in order] != order:
        raise EvidenceError(
            f"{what}: a list of masses names no weights, and its refId has another order than "
            f"the items, so which mass is whose is not said; {_REMEDY}"
        )
    return [each for each, _ in scope]


def _is_of(item: "_Element", named_by: Sequence[str] | None) -> bool:
    return named_by is None or item.get("id") in named_by


def _name_lists(quantity: "_Element", what: str) -> Iterator[list[str]]:
    """What may be names of weights: labels of the list, and texts beside it."""
    values = quantity.find(f"{{{SI}}}realListXMLList")
    assert values is not None
    if values.find(f"{{{SI}}}labelXMLList") is not None:
        yield list_texts(values, "labelXMLList", what)
    parent = quantity.getparent()
    assert parent is not None
    for beside in parent.findall(f"{{{DCC}}}quantity"):
        for chars in beside.findall(f"{{{DCC}}}charsXMLList"):
            yield (leaf_text(chars) or "").split()
        # a text in several languages is said several times
        for content in beside.findall(f"{{{DCC}}}noQuantity/{{{DCC}}}content"):
            yield (leaf_text(content) or "").split()


def _named_items(
    texts: Sequence[str], scope: Sequence[NamedItem], count: int, what: str
) -> list["_Element"] | None:
    """The items that a list of texts names; None where it names none, as a list of classes."""
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
                f"{what}: a list of names beside a list of masses has '{text[:40]}', which "
                f"{len(items)} items of that result are called"
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
