"""Any unit a person writes, converted to the SI unit of the column it fills."""

from functools import cache
from tokenize import TokenError
from typing import Any

from estimators.errors import MachineError

#: What pint lets through of its tokenizer and its evaluation, for text that is no unit.
_UNREADABLE = (
    ArithmeticError,
    AssertionError,
    AttributeError,
    SyntaxError,
    TokenError,
    TypeError,
    ValueError,
)


@cache
def _registry() -> Any:
    import pint

    return pint.UnitRegistry(autoconvert_offset_to_baseunit=True)


@cache
def to_si(unit: str, si: str) -> tuple[float, float]:
    """Gain and offset that turn a number in `unit` into one in `si` (as the schema writes it).

    Raises:
        MachineError: an unknown unit, or one of another dimension.
    """
    import pint

    registry = _registry()
    target = si.replace("·", "*").replace("²", "**2").replace("°", "degree")
    try:
        zero, one = (registry.Quantity(x, unit).to(target).magnitude for x in (0.0, 1.0))
    except pint.DimensionalityError as error:
        raise MachineError(f"unit {unit!r} cannot be converted to {si}") from error
    except (pint.PintError, *_UNREADABLE) as error:
        raise MachineError(
            f"no unit {unit!r}; write for example 'km/h', 'deg/s' or 'kN'"
        ) from error
    return float(one - zero), float(zero)
