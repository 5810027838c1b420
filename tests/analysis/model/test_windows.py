"""Rows near flagged ones."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from analysis.model.windows import flag_rows_near_flagged_rows


@given(st.lists(st.booleans(), max_size=30), st.integers(0, 6), st.none() | st.integers(0, 6))
def test_a_row_is_near_a_flagged_one_of_so_many_before_or_after_it(flags, after, before):
    flagged = np.array(flags, np.bool_)
    near = flag_rows_near_flagged_rows(flagged, after, before)
    reach = after if before is None else before
    for row in range(flagged.size):
        first, end = max(row + 1 - after, 0), row + reach
        assert near[row] == (flagged[first : row + 1].any() or flagged[row:end].any())


@pytest.mark.parametrize(("after", "before", "rows"), [(2, None, 3), (3, 1, 3), (1, None, 1)])
def test_a_single_flag_spreads_to_either_side(after, before, rows):
    flagged = np.arange(9) == 4
    assert np.count_nonzero(flag_rows_near_flagged_rows(flagged, after, before)) == rows
