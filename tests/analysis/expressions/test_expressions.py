"""Arithmetic of channels: a tree with units, whose values are those of polars."""

import numpy as np
import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st

from analysis.expressions.parse import (
    Call,
    Expression,
    ExpressionError,
    Name,
    Number,
    convert_to_si,
    format_expression,
    parse_expression,
)
from analysis.expressions.values import evaluate_and_count_near_zero_divisors
from analysis.model.physical_units import get_unit_registry

UNITS = {
    "torque_N_m": "N*m",
    "power_W": "W",
    "speed_x_m_s": "m/s",
    "motor_rpm": "rpm",
    "wheel_radius_m": "m",
    "current_A": "A",
}
X = {
    "a": np.array([1.0, -2.0, 3.5, 0.25, -7.0]),
    "b": np.array([2.0, 4.0, -1.0, 5.0, 3.0]),
}
FRAME = pl.DataFrame(X)
leaves = st.one_of(
    st.sampled_from([Name("a"), Name("b")]),
    st.floats(0.1, 100).map(lambda x: Number(round(x, 3))),
)


def calls(inner: st.SearchStrategy[Expression]) -> st.SearchStrategy[Expression]:
    two = st.tuples(st.sampled_from(["+", "-", "*", "min", "max", "mean"]), inner, inner)
    one = st.tuples(st.sampled_from(["abs", "sign", "neg"]), inner)
    divided = inner.map(lambda x: Call("/", (x, Name("b"))))
    chosen = st.tuples(inner, inner, inner, st.sampled_from(["<", ">", "<=", ">="])).map(
        lambda p: Call("where", (Call(p[3], (p[0], p[1])), p[1], p[2]))
    )
    return st.one_of(
        two.map(lambda p: Call(p[0], (p[1], p[2]))),
        one.map(lambda p: Call(p[0], (p[1],))),
        divided,
        chosen,
    )


trees = st.recursive(leaves, calls, max_leaves=12)


def by_polars(tree: Expression) -> pl.Expr:
    if isinstance(tree, Number):
        return pl.lit(tree.value)
    if isinstance(tree, Name):
        return pl.col(tree.name)
    if tree.function == "where":
        condition, yes, no = tree.arguments
        assert isinstance(condition, Call)
        left, right = map(by_polars, condition.arguments)
        sign = {"<": left < right, ">": left > right, "<=": left <= right, ">=": left >= right}
        return pl.when(sign[condition.function]).then(by_polars(yes)).otherwise(by_polars(no))
    parts = [by_polars(argument) for argument in tree.arguments]
    if len(parts) == 1:
        (x,) = parts
        return {"abs": x.abs(), "sign": x.sign(), "neg": -x}[tree.function]
    one, two = parts
    return {
        "+": one + two,
        "-": one - two,
        "*": one * two,
        "/": one / two,
        "min": pl.min_horizontal(one, two),
        "max": pl.max_horizontal(one, two),
        "mean": (one + two) / 2,
    }[tree.function]


@given(trees)
def test_what_is_written_is_parsed_to_the_same_tree(tree: Expression) -> None:
    assert format_expression(parse_expression(format_expression(tree))) == format_expression(tree)


@given(trees)
def test_values_are_those_of_polars(tree: Expression) -> None:
    found, _ = evaluate_and_count_near_zero_divisors(tree, X, 5)
    expected = FRAME.select(by_polars(tree).cast(pl.Float64).alias("x"))["x"].to_numpy()
    expected = np.broadcast_to(expected, 5)
    np.testing.assert_allclose(found, np.where(np.isfinite(expected), expected, np.nan), rtol=1e-12)


@pytest.mark.parametrize(
    ("text", "unit"),
    [
        ("torque_N_m * 9.665 / 0.35 [m]", "N"),
        ("power_W / speed_x_m_s", "N"),
        ("motor_rpm * wheel_radius_m", "m/s"),
        ("current_A * 0.12 [N*m/A]", "N*m"),
        ("d/dt speed_x_m_s", "m/s**2"),
        ("where(abs(speed_x_m_s) > 0.36 [km/h], power_W / speed_x_m_s)", "N"),
        ("sign(speed_x_m_s) * min(torque_N_m, 5 [kN*m]) / wheel_radius_m", "N"),
    ],
)
def test_an_expression_has_the_dimension_of_what_it_says(text: str, unit: str) -> None:
    _, dimension = convert_to_si(parse_expression(text), UNITS, get_unit_registry())
    assert dimension == get_unit_registry().Quantity(1, unit).dimensionality


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("torque_N_m + speed_x_m_s", "torque_N_m is .*, speed_x_m_s is .*a sum needs terms"),
        ("max(torque_N_m, 3)", "3 is a pure number"),
        ("where(speed_x_m_s > 1, torque_N_m)", "a comparison needs terms"),
        ("current_A * 2 [bananas]", r"unknown unit 'bananas'"),
    ],
)
def test_units_that_do_not_fit_are_named_on_both_sides(text: str, fault: str) -> None:
    with pytest.raises(ExpressionError, match=fault):
        convert_to_si(parse_expression(text), UNITS, get_unit_registry())


@pytest.mark.parametrize(
    "text",
    [
        *("a +", "(a", "a b", "a ** 2", "__import__('os')", "a.b", "f(a)", "where(a, b)", "1 [m"),
        *("abs()", "max(a)", "d/dt 3", "(" * 200 + "a", "a+" * 400 + "a", "", "a; b", "lambda: 0"),
    ],
)
def test_what_is_no_arithmetic_is_refused_in_a_line(text: str) -> None:
    with pytest.raises(ExpressionError) as caught:
        parse_expression(text)
    assert "\n" not in str(caught.value)


def test_division_near_zero_is_missing_and_counted() -> None:
    v = np.array([0.0, 0.001, 1.0, 2.0, -2.0])
    found, near = evaluate_and_count_near_zero_divisors(
        parse_expression("p / v"), {"p": np.full(5, 6.0), "v": v}, 5
    )
    np.testing.assert_allclose(found, [np.nan, np.nan, 6.0, 3.0, -3.0])
    assert near == 2
