"""What `--over KEY=…` asks for: the values of a setting, and every combination of several."""

from collections.abc import Sequence
from decimal import Decimal
from itertools import product

from estimators.errors import MachineError

#: A grid larger than this is a slip of the pen: days of replays.
_LARGEST = 10_000
_HOW = "write it as KEY=FROM:TO:STEP or KEY=A,B,C, as settings.gate.threshold_nat=0.5:1.5:0.2"


def combinations(over: Sequence[str]) -> list[tuple[str, ...]]:
    """Every combination of the values that are asked for.

    Args:
        over: `key=from:to:step` (both ends included) or `key=a,b,c`.

    Returns:
        Each as overrides of a machine file, `key=value`, in the order of `over`; the last varies
        fastest.

    Raises:
        MachineError: in one line: what is no range or list, a key that is given twice.
    """
    axes = [_axis(each) for each in over]
    keys = [axis[0].partition("=")[0] for axis in axes]
    for key in keys:
        if keys.count(key) > 1:
            raise MachineError(f"--over {key}: is given twice; put its values in one --over")
    size = 1
    for axis in axes:
        size *= len(axis)
    if size > _LARGEST:
        raise MachineError(f"--over: makes {size:,} replays, at most {_LARGEST:,}; widen a step")
    return list(product(*axes))


def _axis(over: str) -> list[str]:
    key, equals, text = (part.strip() for part in over.partition("="))
    if not (key and equals and text):
        raise MachineError(f"--over {over}: {_HOW}")
    values = _range(over, text) if ":" in text else _split_values(text)
    if not all(values):
        raise MachineError(f"--over {over}: a value is missing; {_HOW}")
    return [f"{key}={value}" for value in values]


def _range(over: str, text: str) -> list[str]:
    """The decimal numbers of `from:to:step`, as they would be written."""
    try:
        first, last, step = (Decimal(part.strip()) for part in text.split(":"))
        steps = (last - first) / step
    except (ArithmeticError, ValueError):
        raise MachineError(f"--over {over}: {_HOW}") from None
    if not steps.is_finite() or steps < 0:
        raise MachineError(f"--over {over}: no step of {step} leads from {first} to {last}")
    if steps >= _LARGEST:
        raise MachineError(f"--over {over}: makes more than {_LARGEST:,} values; widen the step")
    return [f"{first + k * step:f}" for k in range(int(steps) + 1)]


def _split_values(text: str) -> list[str]:
    """The values between commas; those inside brackets are one value."""
    values, depth = [""], 0
    for letter in text:
        depth += (letter in "[{") - (letter in "]}")
        if letter == "," and depth == 0:
            values.append("")
        else:
            values[-1] += letter
    return [value.strip() for value in values]
