"""What changes under way by more than a machine carries is no load."""

import re
from pathlib import Path

import pytest

from replay import open_log, run
from replay.logs import TimeAxis
from tests.analysis.without_bucket import WITHOUT_BUCKET
from tests.twins import mark_heavy_after, mark_slow_after


@pytest.mark.heavy
@pytest.mark.parametrize("seed", mark_slow_after(1, range(6)))
@pytest.mark.parametrize("name", mark_heavy_after(1, ["a rack", "an arm"]))
def test_no_load_is_said_that_the_machine_could_not_carry(
    name: str, seed: int, tmp_path: Path
) -> None:
    drawn = WITHOUT_BUCKET[name](seed)
    path = tmp_path / "drawn.parquet"
    drawn.table.write_parquet(path)
    with open_log(path, time=TimeAxis("t")) as log:
        (said, *_) = run(log, drawn.machine).frames["loads"]["said"]
    for kg in re.findall(r"by about ([+-][\d,]+) ±", said):
        assert abs(float(kg.replace(",", ""))) < drawn.mass_kg, said
