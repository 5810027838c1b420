"""Reference masses out of a digital calibration certificate (DKD-E 7-2 for weights, and others)."""

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from estimators.errors import EvidenceError
from recordings.dcc.dcc_document import DCC, SI, leaf_text

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
#: What a quantity that is the mass calls itself, the best first. Conventional mass is what weights
#: are certified in; of steel it differs from the mass by less than 1e-6.
_KINDS: Final = ("conventionalMass", "mass", "measuredValue")
_NUMBER: Final = re.compile(r"[-+]?(\d*\.\d+|\d+\.?\d*)([Ee][-+]?\d+)?")
#: Characters of a number, of which no certificate needs more.
_MOST_DIGITS: Final = 40
#: A weight that is known less well than to 10 % is a misread unit.
_MOST_U_1: Final = 0.1
_MOST_KG: Final = 1e6
#: Coverage factors beyond are no interval of 99.99 % even with two degrees of freedom.
_MOST_K: Final = 100.0
_MOST_NAMED: Final = 12


@dataclass(frozen=True, slots=True)
class CertifiedMass:
    """A mass as a certificate has it.

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


def certified_masses(root: "_Element", item: str, what: str) -> list[CertifiedMass]:
    """Read the masses of a certificate.

    Args:
        root: of the certificate, as far as it is signed.
        item: which one, by its id or an identification; "" for all.
        what: the certificate's name, for errors.

    Raises:
        EvidenceError: no such item, no or several masses of it, another unit, a value or an
            uncertainty that is none, or an uncertainty without its coverage factor.
    """
    admin = root.find(f"{{{DCC}}}administrativeData")
    assert admin is not None
    items = admin.findall(f"{{{DCC}}}items/{{{DCC}}}item")
    named = [(each, _names(each)) for each in items]
    wanted = [(each, names) for each, names in named if not item or item in names]
    if not wanted or any(not names for _, names in wanted):
        choices = ", ".join(names[0] for _, names in named if names)[:400] or "none with an id"
        raise EvidenceError(f"{what}: has no item '{item}'; its items: {choices}")
    if item and len(wanted) > 1:
        raise EvidenceError(f"{what}: has {len(wanted)} items '{item}'")
    core = admin.find(f"{{{DCC}}}coreData")
    assert core is not None
    certificate = leaf_text(core.find(f"{{{DCC}}}uniqueIdentifier")) or ""
    contact = f"{{{DCC}}}calibrationLaboratory/{{{DCC}}}contact/{{{DCC}}}name/{{{DCC}}}content"
    issuer = leaf_text(admin.find(contact)) or ""
    if not issuer:
        raise EvidenceError(f"{what}: does not name its laboratory")
    found: list[CertifiedMass] = []
    for element, names in wanted:
        about = f"{what}, item '{names[0]}'"
        value_kg, u_kg = _mass(root, element, alone=len(items) == 1, what=about)
        found.append(CertifiedMass(item or names[0], value_kg, u_kg, certificate, issuer))
    return found


def _names(item: "_Element") -> list[str]:
    """What an item may be called by."""
    values = item.findall(f"{{{DCC}}}identifications/{{{DCC}}}identification/{{{DCC}}}value")
    names = [item.get("id"), *(leaf_text(value) for value in values)]
    return [name for name in names if name]


def _mass(root: "_Element", item: "_Element", *, alone: bool, what: str) -> tuple[float, float]:
    """Value and standard uncertainty of the one quantity that is the item's mass."""
    quantities = list(_quantities(root, item.get("id"), alone=alone))
    for kind in _KINDS:
        chosen = [each for each in quantities if kind in _kinds(each)]
        if len(chosen) > 1:
            raise EvidenceError(f"{what}: has {len(chosen)} quantities of the kind '{kind}'")
        if chosen:
            return _value(chosen[0], what)
    kinds = sorted({kind for each in quantities for kind in _kinds(each)})[:_MOST_NAMED]
    raise EvidenceError(
        f"{what}: no quantity of it is a mass by its refType ({', '.join(_KINDS)}); "
        f"there {'are ' + ', '.join(kinds) if kinds else 'is none'}"
    )


def _kinds(quantity: "_Element") -> list[str]:
    """What a quantity calls itself: its refTypes without what they are prefixed with."""
    return [name.rpartition("_")[2] for name in quantity.get("refType", "").split()]


def _quantities(root: "_Element", item_id: str | None, *, alone: bool) -> Iterator["_Element"]:
    """The quantities of results that are of an item."""
    results = root.find(f"{{{DCC}}}measurementResults")
    assert results is not None
    for quantity in results.iterfind(f".//{{{DCC}}}results//{{{DCC}}}quantity"):
        own: list[str] | None = None
        place: _Element | None = quantity
        while place is not None and own is None:
            own = place.get("refId", "").split() or None
            place = place.getparent()
        if (own is None and alone) or (own is not None and item_id in own):
            yield quantity


def _value(quantity: "_Element", what: str) -> tuple[float, float]:
    """Value and standard uncertainty of a quantity, in kg."""
    reals = quantity.findall(f"{{{SI}}}real")
    if len(reals) != 1:
        raise EvidenceError(f"{what}: its mass is not one si:real")
    real = reals[0]
    unit = _one(real, "unit", what)
    if unit not in _UNITS_KG:
        raise EvidenceError(
            f"{what}: its mass has the unit '{unit[:40]}'; of mass are {', '.join(_UNITS_KG)}"
        )
    value_kg = _number(_one(real, "value", what), "value", what) * _UNITS_KG[unit]
    u_kg = _standard_u(real, what) * _UNITS_KG[unit]
    if not 0.0 < value_kg <= _MOST_KG:
        raise EvidenceError(f"{what}: {value_kg:g} kg is no mass of a weight")
    if not 0.0 < u_kg <= _MOST_U_1 * value_kg:
        raise EvidenceError(
            f"{what}: a standard uncertainty of {u_kg:g} kg is none of {value_kg:g} kg"
        )
    return value_kg, u_kg


def _standard_u(real: "_Element", what: str) -> float:
    """Standard uncertainty in the unit of the value."""
    expanded = list(real.iter(f"{{{SI}}}expandedUnc"))
    interval = list(real.iter(f"{{{SI}}}coverageInterval"))
    if len(expanded) + len(interval) != 1:
        raise EvidenceError(f"{what}: has {len(expanded) + len(interval)} uncertainties, not one")
    if interval:
        return _number(_one(interval[0], "standardUnc", what), "standardUnc", what)
    k = _number(_one(expanded[0], "coverageFactor", what), "coverageFactor", what)
    if not 1.0 <= k <= _MOST_K:
        raise EvidenceError(f"{what}: {k:g} is no coverage factor")
    p = _number(_one(expanded[0], "coverageProbability", what), "coverageProbability", what)
    if not 0.5 <= p < 1.0:
        raise EvidenceError(f"{what}: {p:g} is no coverage probability of an expanded uncertainty")
    return _number(_one(expanded[0], "uncertainty", what), "uncertainty", what) / k


def _one(inside: "_Element", name: str, what: str) -> str:
    """The text of the one child of a name."""
    found = inside.findall(f"{{{SI}}}{name}")
    text = leaf_text(found[0]) if len(found) == 1 else None
    if not text:
        raise EvidenceError(f"{what}: its {inside.tag.rpartition('}')[2]} has no single si:{name}")
    return text


def _number(text: str, name: str, what: str) -> float:
    if len(text) > _MOST_DIGITS or not _NUMBER.fullmatch(text):
        raise EvidenceError(f"{what}: its si:{name} '{text[:40]}' is no decimal number")
    value = float(text)
    if not math.isfinite(value):
        raise EvidenceError(f"{what}: its si:{name} '{text[:40]}' is not finite")
    return value
