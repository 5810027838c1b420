"""Strict validation of values stated by a person or a file."""

from typing import Final

from pydantic import ConfigDict

#: Fixed once made, no unknown key, no infinity and no NaN.
STRICT: Final = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)
