"""A load that counts is doubted where its numbers cannot be right."""

import polars as pl
import pytest

from recordings.review.shift_ledger import describe_doubts_of_each_cycle
from tests.analysis.cycles.drawn import drawn_shift
from tests.analysis.cycles.test_cycles import found

LOADS = [700.0, 650.0, 720.0, 680.0, 690.0, 710.0, 705.0, 660.0, 675.0]


def doubts_of_third(**values: float) -> str:
    table = found(drawn_shift(LOADS)).with_columns(
        payload_u_kg=pl.lit(25.0), carry_back_kg=pl.lit(5.0), carry_back_u_kg=pl.lit(30.0)
    )
    third = pl.col("cycle") == 3
    changed = [
        pl.when(third).then(value).otherwise(name).alias(name) for name, value in values.items()
    ]
    doubts = describe_doubts_of_each_cycle(table.with_columns(changed))
    assert not any(doubts[:2] + doubts[3:])
    return doubts[2]


def test_a_plain_load_is_not_doubted() -> None:
    assert doubts_of_third() == ""


@pytest.mark.parametrize(
    ("values", "part"),
    [
        ({"carry_back_kg": -147.0}, "147 kg less than empty"),
        ({"carry_back_kg": 211.0}, "211 kg still in the bucket"),
        ({"payload_kg": 1500.0}, "unlike the other payloads"),
        ({"payload_kg": 30.0, "payload_u_kg": 20.0}, "may be zero"),
    ],
)
def test_what_cannot_be_right_is_said(values: dict[str, float], part: str) -> None:
    assert part in doubts_of_third(**values)


def test_what_the_uncertainty_explains_is_not_doubted() -> None:
    assert doubts_of_third(carry_back_kg=-147.0, carry_back_u_kg=90.0) == ""
