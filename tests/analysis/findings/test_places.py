"""Where stamps stand among those of the grid."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from analysis.findings.finding_inputs import find_insertion_indices_of_stamps

stamps = st.lists(st.integers(0, 50), max_size=30).map(lambda each: np.array(each, np.int64))


@given(stamps, stamps)
def test_they_are_those_of_a_search(grid, asked):
    grid = np.unique(grid)
    np.testing.assert_array_equal(
        find_insertion_indices_of_stamps(grid, asked), np.searchsorted(grid, asked)
    )
