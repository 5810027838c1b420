"""Units of expressions: checks that terms have the same dimension, and converts to SI."""

from collections.abc import Mapping
from typing import Any, Final

from analysis.expressions.parse import (
    COMPARISONS,
    SLOPE,
    Call,
    Expression,
    ExpressionError,
    Name,
    Number,
)

_DIMENSIONLESS = ("sign",)


def convert_to_si(
    tree: Expression, units: Mapping[str, str], registry: Any
) -> tuple[Expression, Any]:
    """Convert all names and constants of an expression to SI units.

    Args:
        tree: the expression.
        units: unit of each name, in pint's notation; "" for a pure number.
        registry: pint's unit registry.

    Returns:
        The expression with unitless numbers, and its dimension as pint's object.

    Raises:
        ExpressionError: two sides cannot be added or compared (it names both), or an unknown unit.
    """
    if isinstance(tree, Name):
        gain, dimension = si_gain_and_dimension(units[tree.name], tree.name, registry)
        return (tree if gain == 1.0 else Call("*", (Number(gain), tree))), dimension
    if isinstance(tree, Number):
        gain, dimension = si_gain_and_dimension(tree.unit or "", expression_text(tree), registry)
        return Number(tree.value * gain), dimension
    parts = [convert_to_si(argument, units, registry) for argument in tree.arguments]
    found = Call(tree.function, tuple(part for part, _ in parts))
    return found, _derive_dimension(tree, [dimension for _, dimension in parts], registry)


def _derive_dimension(tree: Call, argument_dimensions: list[Any], registry: Any) -> Any:
    """Dimension of a call's result; an error if its arguments differ."""
    none = registry.dimensionless.dimensionality
    if tree.function == "*":
        return argument_dimensions[0] * argument_dimensions[1]
    if tree.function == "/":
        return argument_dimensions[0] / argument_dimensions[1]
    if tree.function == SLOPE:
        return argument_dimensions[0] / registry.second.dimensionality
    values, arguments = argument_dimensions, tree.arguments
    if tree.function == "where":
        values, arguments = argument_dimensions[1:], tree.arguments[1:]
    for other, argument in zip(values[1:], arguments[1:], strict=True):
        if other != values[0]:
            one, differs = expression_text(arguments[0]), expression_text(argument)
            raise ExpressionError(
                f"{one} is {format_dimension(values[0])}, {differs} is {format_dimension(other)}: "
                f"they cannot stand in one {_WORDS.get(tree.function, tree.function)}"
            )
    return none if tree.function in (*_DIMENSIONLESS, *COMPARISONS) else values[0]


_WORDS = {"+": "sum", "-": "difference", **dict.fromkeys(COMPARISONS, "comparison")}


#: What a person calls the SI unit of a dimension: exponents of kg, m, s, A.
_NAMES: Final[dict[tuple[float, ...], str]] = {
    (1, 1, -2, 0): "N",
    (1, 2, -2, 0): "N·m",
    (1, 2, -3, 0): "W",
    (1, -1, -2, 0): "Pa",
    (0, 1, -1, 0): "m/s",
    (0, 1, -2, 0): "m/s²",
    (0, 0, -1, 0): "1/s",
    (1, 2, -3, -1): "V",
    (1, 2, -2, -1): "N·m/A",
}
_BASE = {"[mass]": "kg", "[length]": "m", "[time]": "s", "[current]": "A"}


def format_dimension(dimension: Any) -> str:
    """Dimension as text, by its SI unit: `in N·m`."""
    if not dimension:
        return "a pure number"
    powers: dict[str | None, float] = {
        _BASE.get(name, name.strip("[]")): power for name, power in dimension.items()
    }
    exact = tuple(powers.get(unit, 0) for unit in _BASE.values())
    if set(powers) <= set(_BASE.values()) and exact in _NAMES:
        return f"in {_NAMES[exact]}"
    parts = (str(unit) if power == 1 else f"{unit}^{power:g}" for unit, power in powers.items())
    return f"in {'·'.join(parts)}"


def si_gain_and_dimension(unit: str, expression: str, registry: Any) -> tuple[float, Any]:
    """Factor that converts a number to SI units, and its dimension."""
    import pint

    text = unit.replace("·", "*").replace("²", "**2").replace("°", "degree")
    try:
        quantity = registry.Quantity(1.0, registry.parse_units(text)) if text else None
        if quantity is None:
            return 1.0, registry.dimensionless.dimensionality
        zero = registry.Quantity(0.0, quantity.units).to_base_units().magnitude
        base = quantity.to_base_units()
    except (pint.PintError, AttributeError, TypeError, ValueError) as error:
        raise ExpressionError(f"{expression}: no unit '{unit}'") from error
    if zero:
        raise ExpressionError(
            f"{expression}: '{unit}' has an offset zero point, so it cannot be multiplied or "
            "divided; use a unit such as K"
        )
    return float(base.magnitude), base.dimensionality


def expression_text(tree: Expression) -> str:
    """Text of an expression."""
    if isinstance(tree, Name):
        return tree.name
    if isinstance(tree, Number):
        return f"{tree.value:g}" + (f" [{tree.unit}]" if tree.unit else "")
    parts = [expression_text(argument) for argument in tree.arguments]
    if tree.function == "neg":
        return f"-{parts[0]}"
    if tree.function == SLOPE:
        return f"d/dt {parts[0]}"
    if tree.function in COMPARISONS:
        return f"{parts[0]} {tree.function} {parts[1]}"
    if len(parts) == 2 and not tree.function.isalpha():
        return f"({parts[0]} {tree.function} {parts[1]})"
    return f"{tree.function}({', '.join(parts)})"
