"""Strict validation of values stated by a person or a file."""

from typing import Final

from pydantic import ConfigDict

#: Immutable; unknown keys, infinity and NaN are errors.
STRICT: Final = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)
