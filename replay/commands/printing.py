"""Values as JSON: what is not finite is null, as JSON knows no other."""

import json
import math
from typing import Any

import typer


def print_json(value: Any) -> None:
    """Print a value as JSON on stdout."""
    typer.echo(json_text(value))


def json_text(value: Any) -> str:
    """A value as JSON text; NaN and infinities become null."""
    return json.dumps(_plain(value), indent=2, ensure_ascii=False, allow_nan=False)


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
