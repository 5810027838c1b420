"""Parser of the text of `derive`, such as `torque_N_m * 9.665 / 0.35 [m]`, and its units.

Terms must have the same dimension; constants are converted to SI.
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, Final

from analysis.expressions.expression_limits import LIMITS

_TOKEN: Final = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)"
    r"|(?P<slope>d/dt\b)|(?P<name>[A-Za-z_]\w*)"
    r"|(?P<unit>\[[^\[\]]*\])|(?P<sign><=|>=|[-+*/(),<>]))"
)
#: Functions, with the fewest and the most arguments that each takes.
FUNCTIONS: Final = {
    "abs": (1, 1),
    "sign": (1, 1),
    "min": (2, 20),
    "max": (2, 20),
    "mean": (2, 20),
    "where": (2, 3),
}
#: The derivative of a channel by time.
SLOPE: Final = "d/dt"
COMPARISONS: Final = ("<", ">", "<=", ">=")
_DIMENSIONLESS = ("sign",)


class ExpressionError(ValueError):
    """Error in an expression, described in one line."""


@dataclass(frozen=True, slots=True)
class Number:
    """Constant in `unit`; dimensionless if that is None."""

    value: float
    unit: str | None = None


@dataclass(frozen=True, slots=True)
class Name:
    """Name of a channel or of a key of `[machine]`."""

    name: str


@dataclass(frozen=True, slots=True)
class Call:
    """Function and its arguments; `+ - * /` and comparisons have two, `neg` has one."""

    function: str
    arguments: tuple["Expression", ...]


Expression = Number | Name | Call


def iter_channel_names(tree: Expression) -> Iterator[str]:
    """Yield the names in an expression from left to right, repeated ones included."""
    if isinstance(tree, Name):
        yield tree.name
    elif isinstance(tree, Call):
        for argument in tree.arguments:
            yield from iter_channel_names(argument)


def iter_differentiated_channels(tree: Expression) -> Iterator[str]:
    """Yield the channels whose derivative an expression takes."""
    if isinstance(tree, Call):
        if tree.function == SLOPE:
            yield from iter_channel_names(tree)
        for argument in tree.arguments:
            yield from iter_differentiated_channels(argument)


@cache
def parse_expression(text: str) -> Expression:
    """Parse an expression.

    Raises:
        ExpressionError: the text is not an expression; the message says what was expected where.
    """
    if len(text) > LIMITS.expression_characters:
        raise ExpressionError(
            f"the expression has {len(text)} characters; shorten it to at most "
            f"{LIMITS.expression_characters}"
        )
    parser = _Parser(text)
    tree = parser.parse_sum(0)
    if parser.kind:
        raise parser.make_syntax_error("an operator")
    return tree


class _Parser:
    """Recursive-descent parser, with one method per level of precedence."""

    def __init__(self, text: str) -> None:
        self._text, self._at = text, 0
        self.kind, self.value = "", ""
        self._advance_to_next_token()

    def _advance_to_next_token(self) -> None:
        if not self._text[self._at :].strip():
            self.kind, self.value = "", ""
            return
        match = _TOKEN.match(self._text, self._at)
        if match is None:
            raise ExpressionError(
                f"cannot read '{self._text[self._at :].strip()[:20]}' in '{self._text}'; write "
                "names, numbers, [units], + - * / < > <= >=, brackets and functions"
            )
        self.kind, self.value = str(match.lastgroup), match[str(match.lastgroup)]
        self._at = match.end()

    def make_syntax_error(self, expected: str) -> ExpressionError:
        found = f"'{self.value}'" if self.kind else "the end"
        return ExpressionError(f"'{self._text}': expected {expected}, found {found}")

    def _take_token_if_one_of(self, *signs: str) -> str:
        if self.kind == "sign" and self.value in signs:
            sign = self.value
            self._advance_to_next_token()
            return sign
        return ""

    def parse_sum(self, depth: int) -> Expression:
        if depth > LIMITS.bracket_depth:
            raise ExpressionError(
                f"brackets are nested more than {LIMITS.bracket_depth} deep; simplify them"
            )
        left = self._parse_product(depth)
        while sign := self._take_token_if_one_of("+", "-"):
            left = Call(sign, (left, self._parse_product(depth)))
        return left

    def _parse_product(self, depth: int) -> Expression:
        left = self._parse_signed_operand(depth)
        while sign := self._take_token_if_one_of("*", "/"):
            left = Call(sign, (left, self._parse_signed_operand(depth)))
        return left

    def _parse_signed_operand(self, depth: int) -> Expression:
        negative = False
        while sign := self._take_token_if_one_of("-", "+"):
            negative ^= sign == "-"
        tree = self._parse_operand(depth)
        return Call("neg", (tree,)) if negative else tree

    def _parse_operand(self, depth: int) -> Expression:
        kind, value = self.kind, self.value
        if self._take_token_if_one_of("("):
            tree = self.parse_sum(depth + 1)
            self._require_closing_bracket()
            return tree
        if kind not in ("number", "name", "slope"):
            raise self.make_syntax_error("a channel, a number or '('")
        self._advance_to_next_token()
        if kind == "number":
            return Number(float(value), self._parse_unit())
        if kind == "slope":
            bracket = self._take_token_if_one_of("(")
            if self.kind != "name":
                raise self.make_syntax_error("the channel that d/dt differentiates")
            tree = Name(self.value)
            self._advance_to_next_token()
            if bracket:
                self._require_closing_bracket()
            return Call(SLOPE, (tree,))
        if self._take_token_if_one_of("("):
            return self._parse_call(value, depth + 1)
        return Name(value)

    def _parse_unit(self) -> str | None:
        if self.kind != "unit":
            return None
        unit = self.value[1:-1].strip()
        self._advance_to_next_token()
        return unit or None

    def _parse_call(self, function: str, depth: int) -> Expression:
        if function not in FUNCTIONS:
            known = ", ".join(FUNCTIONS)
            raise ExpressionError(f"no function '{function}'; known: {known}, d/dt")
        arguments = [
            self._parse_comparison(depth) if function == "where" else self.parse_sum(depth)
        ]
        while self._take_token_if_one_of(","):
            arguments.append(self.parse_sum(depth))
        self._require_closing_bracket()
        fewest, most = FUNCTIONS[function]
        if not fewest <= len(arguments) <= most:
            wanted = str(fewest) if fewest == most else f"{fewest} to {most}"
            raise ExpressionError(f"{function}() takes {wanted} arguments, not {len(arguments)}")
        return Call(function, tuple(arguments))

    def _parse_comparison(self, depth: int) -> Expression:
        left = self.parse_sum(depth)
        sign = self._take_token_if_one_of(*COMPARISONS)
        if not sign:
            raise self.make_syntax_error("a comparison, as in where(speed_x_m_s > 0.1 [m/s], …)")
        return Call(sign, (left, self.parse_sum(depth)))

    def _require_closing_bracket(self) -> None:
        if not self._take_token_if_one_of(")"):
            raise self.make_syntax_error("')'")


def convert_to_si(
    tree: Expression, units: Mapping[str, str], registry: Any
) -> tuple[Expression, Any]:
    """Convert all names and constants of an expression to SI units.

    Args:
        tree: the expression.
        units: unit of each name, in pint's notation; "" if dimensionless.
        registry: pint's unit registry.

    Returns:
        The expression with unitless numbers, and its dimension as pint's object.

    Raises:
        ExpressionError: an unknown unit, or two sides that cannot be added or compared (the message
            names both).
    """
    if isinstance(tree, Name):
        gain, dimension = find_si_gain_and_dimension(units[tree.name], tree.name, registry)
        return (tree if gain == 1.0 else Call("*", (Number(gain), tree))), dimension
    if isinstance(tree, Number):
        gain, dimension = find_si_gain_and_dimension(
            tree.unit or "", format_expression(tree), registry
        )
        return Number(tree.value * gain), dimension
    parts = [convert_to_si(argument, units, registry) for argument in tree.arguments]
    found = Call(tree.function, tuple(part for part, _ in parts))
    return found, derive_dimension_of_call(tree, [dimension for _, dimension in parts], registry)


def derive_dimension_of_call(tree: Call, argument_dimensions: list[Any], registry: Any) -> Any:
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
            one, differs = format_expression(arguments[0]), format_expression(argument)
            raise ExpressionError(
                f"{one} is {format_dimension(values[0])}, {differs} is {format_dimension(other)}: "
                f"a {_WORDS.get(tree.function, tree.function)} needs terms of the same dimension"
            )
    return none if tree.function in (*_DIMENSIONLESS, *COMPARISONS) else values[0]


_WORDS = {"+": "sum", "-": "difference", **dict.fromkeys(COMPARISONS, "comparison")}

#: Common name of the SI unit of a dimension, by the exponents of kg, m, s, A.
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


def format_unit_for_pint(unit: str) -> str:
    """A unit of the schema (`N·m`, `m/s²`, `°`) in pint's notation; others stay unchanged."""
    return unit.replace("·", "*").replace("²", "**2").replace("°", "degree")


def find_si_gain_and_dimension(unit: str, expression: str, registry: Any) -> tuple[float, Any]:
    """Factor that converts a number to SI units, and its dimension."""
    import pint

    text = format_unit_for_pint(unit)
    try:
        quantity = registry.Quantity(1.0, registry.parse_units(text)) if text else None
        if quantity is None:
            return 1.0, registry.dimensionless.dimensionality
        zero = registry.Quantity(0.0, quantity.units).to_base_units().magnitude
        base = quantity.to_base_units()
    except (pint.PintError, AttributeError, TypeError, ValueError) as error:
        raise ExpressionError(
            f"{expression}: unknown unit '{unit}'; write it like N*m or m/s"
        ) from error
    if zero:
        raise ExpressionError(
            f"{expression}: '{unit}' has an offset zero point, so it cannot be multiplied or "
            "divided; use a unit such as K"
        )
    return float(base.magnitude), base.dimensionality


def format_expression(tree: Expression) -> str:
    """Convert an expression back to text."""
    if isinstance(tree, Name):
        return tree.name
    if isinstance(tree, Number):
        return f"{tree.value:g}" + (f" [{tree.unit}]" if tree.unit else "")
    parts = [format_expression(argument) for argument in tree.arguments]
    if tree.function == "neg":
        return f"-{parts[0]}"
    if tree.function == SLOPE:
        return f"d/dt {parts[0]}"
    if tree.function in COMPARISONS:
        return f"{parts[0]} {tree.function} {parts[1]}"
    if len(parts) == 2 and not tree.function.isalpha():
        return f"({parts[0]} {tree.function} {parts[1]})"
    return f"{tree.function}({', '.join(parts)})"
