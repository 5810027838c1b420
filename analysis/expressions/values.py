"""Evaluation of expressions on arrays."""

from collections.abc import Callable, Mapping
from typing import Final

import numpy as np

from analysis.expressions.expression_limits import LIMITS
from analysis.expressions.parse import SLOPE, Call, Expression, Name, Number
from estimators.arrays import Floats

_OF_TWO: Final[Mapping[str, Callable[..., Floats]]] = {
    "+": np.add,
    "-": np.subtract,
    "*": np.multiply,
    "<": np.less,
    ">": np.greater,
    "<=": np.less_equal,
    ">=": np.greater_equal,
}
_OF_ONE: Final[Mapping[str, Callable[..., Floats]]] = {
    "neg": np.negative,
    "abs": np.abs,
    "sign": np.sign,
}
_OF_MANY: Final[Mapping[str, Callable[..., Floats]]] = {"min": np.minimum, "max": np.maximum}


def evaluate_and_count_near_zero_divisors(
    tree: Expression, values: Mapping[str, Floats], size: int
) -> tuple[Floats, int]:
    """Evaluate an expression.

    Args:
        tree: expression in SI units.
        values: (size,) values of each name in SI units; a channel's derivative as `d/dt NAME`.
        size: number of values.

    Returns:
        (size,) values, NaN if undefined, and the number of divisions by nearly zero.
    """
    near_zero = 0

    def evaluate_node(node: Expression) -> Floats:
        nonlocal near_zero
        if isinstance(node, Number):
            return np.full(size, node.value)
        if isinstance(node, Name):
            return np.broadcast_to(values[node.name], size)
        if node.function == SLOPE:
            (argument,) = node.arguments
            scale, name = find_derivative_gain_and_channel(argument)
            return scale * values[f"{SLOPE} {name}"]
        parts = [evaluate_node(argument) for argument in node.arguments]
        if node.function == "/":
            quotient, bad = divide_and_count_near_zero_divisors(parts[0], parts[1])
            near_zero += bad
            return quotient
        return _apply_function(node, parts)

    with np.errstate(over="ignore", invalid="ignore"):
        found = evaluate_node(tree)
    return np.where(np.isfinite(found), found, np.nan), near_zero


def _apply_function(node: Call, argument_values: list[Floats]) -> Floats:
    if node.function in _OF_TWO:
        return _OF_TWO[node.function](argument_values[0], argument_values[1])
    if node.function in _OF_ONE:
        return _OF_ONE[node.function](argument_values[0])
    if node.function in _OF_MANY:
        found = argument_values[0]
        for part in argument_values[1:]:
            found = _OF_MANY[node.function](found, part)
        return found
    if node.function == "mean":
        return np.asarray(np.sum(argument_values, axis=0) / len(argument_values), np.float64)
    # a comparison with a missing value is missing
    condition = node.arguments[0]
    assert node.function == "where"
    assert isinstance(condition, Call)
    otherwise = (
        argument_values[2] if len(argument_values) > 2 else np.full(argument_values[0].size, np.nan)
    )
    return np.where(argument_values[0].astype(np.bool_), argument_values[1], otherwise)


def divide_and_count_near_zero_divisors(dividend: Floats, divisor: Floats) -> tuple[Floats, int]:
    """Quotient, NaN if the divisor is near zero, and the number of such divisions."""
    known = np.abs(divisor[np.isfinite(divisor)])
    limit = (
        LIMITS.near_zero_fraction * float(np.percentile(known, LIMITS.divisor_percentile))
        if known.size
        else 0.0
    )
    near = np.isfinite(divisor) & ((np.abs(divisor) < limit) | (divisor == 0.0))
    return np.divide(dividend, divisor, out=np.full(divisor.size, np.nan), where=~near), int(
        near.sum()
    )


def find_derivative_gain_and_channel(tree: Expression) -> tuple[float, str]:
    """Gain and name of a differentiated channel."""
    if isinstance(tree, Name):
        return 1.0, tree.name
    assert isinstance(tree, Call)
    gain, name = tree.arguments
    assert isinstance(gain, Number)
    assert isinstance(name, Name)
    return gain.value, name.name
