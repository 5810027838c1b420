"""A process ends although polars still reads a chunk of which nobody wants a row any more."""

import subprocess
import sys

import pytest

#: Takes the head of a source whose chunks take long, and ends.
TAKES_THE_HEAD = """
import sys, time
from types import SimpleNamespace
import polars as pl
from replay.frames.scan import make_lazy_frame_of_topic

def batches(columns, predicate, n_rows):
    for chunk in range(1000):
        time.sleep(0.05)
        rows = pl.DataFrame({"x": range(chunk * 10, chunk * 10 + 10)})
        yield rows if predicate is None else rows.filter(predicate)

source = SimpleNamespace(schema=pl.Schema({"x": pl.Int64}), topic="slow", iter_row_batches=batches)
rows = make_lazy_frame_of_topic(source).filter(pl.col("x") > 3).head(3).collect(engine="streaming")
print(rows["x"].to_list(), flush=True)
"""


@pytest.mark.heavy
def test_a_script_that_takes_the_head_of_a_log_ends_well():
    for _ in range(3):
        left = subprocess.run(
            [sys.executable, "-P", "-c", TAKES_THE_HEAD],
            capture_output=True, text=True, check=False, timeout=60,
        )  # fmt: skip
        assert (left.returncode, left.stdout, left.stderr) == (0, "[4, 5, 6]\n", "")
