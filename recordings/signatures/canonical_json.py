"""Encode canonical JSON (RFC 8785), which has exactly one byte sequence per value, and parse it.

Parsed data may be untrusted: size, depth, numbers and names are limited before and during parsing.
"""

import json
import math
from typing import Any, Final

from estimators.errors import EvidenceError
from recordings.signatures.signature_limits import LIMITS

#: Largest integer that is exact in a double, which is how canonical JSON defines numbers.
_LARGEST_EXACT: Final = 2**53 - 1
_OPEN, _CLOSE, _QUOTE, _ESCAPE = b"[{", b"]}", ord('"'), ord("\\")


def encode_canonical_json(value: Any) -> bytes:
    """Encode a JSON value as canonical bytes.

    Raises:
        EvidenceError: the value has NaN, infinity or an integer beyond 2^53, which JSON lacks.
    """
    import rfc8785

    try:
        return rfc8785.dumps(value)
    except rfc8785.CanonicalizationError as error:
        raise EvidenceError(
            "a value cannot be written as canonical JSON, which has no NaN, infinity or whole "
            f"numbers beyond 2^53: {error}"
        ) from None


def parse_canonical_json(json_bytes: bytes, source: str) -> Any:
    """Parse untrusted canonical JSON.

    Args:
        json_bytes: bytes to parse.
        source: name of the data, for the error.

    Raises:
        EvidenceError: the bytes are too many, nested too deeply, have a number that is too long or
            too large or a repeated name, are not JSON, or not in canonical form.
    """
    if len(json_bytes) > LIMITS.document_bytes:
        raise EvidenceError(
            f"{source}: has more than {LIMITS.document_bytes >> 20} MiB, the most that evidence "
            "may have"
        )
    _refuse_deep_nesting(json_bytes, source)
    try:
        value = json.loads(
            json_bytes.decode("utf-8"),
            parse_int=_parse_integer_or_float_if_beyond_exact_range,
            parse_float=_parse_json_float,
            parse_constant=_refuse_json_constant,
            object_pairs_hook=_make_object_of_unique_names,
        )
    except (ValueError, RecursionError) as error:
        raise EvidenceError(f"{source}: is not valid JSON for evidence: {error}") from None
    if encode_canonical_json(value) != json_bytes:
        raise EvidenceError(
            f"{source}: is not in the canonical form of RFC 8785, so it was reformatted or "
            "changed; copy the original file again"
        )
    return value


def _refuse_deep_nesting(json_bytes: bytes, source: str) -> None:
    """Raise an error for data nested too deeply, by counting brackets outside texts."""
    depth, quoted, escaped = 0, False, False
    for byte in json_bytes:
        if quoted:
            if escaped:
                escaped = False
            elif byte == _ESCAPE:
                escaped = True
            elif byte == _QUOTE:
                quoted = False
        elif byte == _QUOTE:
            quoted = True
        elif byte in _OPEN:
            depth += 1
            if depth > LIMITS.document_depth:
                raise EvidenceError(
                    f"{source}: is nested deeper than the {LIMITS.document_depth} levels allowed"
                )
        elif byte in _CLOSE:
            depth -= 1


def _parse_integer_or_float_if_beyond_exact_range(text: str) -> int | float:
    if len(text) > LIMITS.number_characters:
        raise ValueError(
            f"a number has {len(text)} digits; at most {LIMITS.number_characters} are allowed"
        )
    value = int(text)
    # in canonical form, a double such as 1e20 is written with all its digits
    return value if abs(value) <= _LARGEST_EXACT else float(value)


def _parse_json_float(text: str) -> float:
    if len(text) > LIMITS.number_characters:
        raise ValueError(
            f"a number has {len(text)} characters; at most {LIMITS.number_characters} are allowed"
        )
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"the number {text} is too large")
    return value


def _refuse_json_constant(text: str) -> float:
    raise ValueError(f"it contains {text}, which JSON does not allow")


def _make_object_of_unique_names(name_value_pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Make a JSON object from its pairs; raise an error for a repeated name."""
    found = dict(name_value_pairs)
    if len(found) != len(name_value_pairs):
        raise ValueError("a name appears twice in one object")
    return found
