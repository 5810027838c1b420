"""What each manoeuvre says of its level, effects that all share aside."""

import numpy as np
import pytest

from estimators.joint.unit_levels import estimate_unit_levels


class TestUnits:
    def test_a_unit_says_its_level_and_how_certain_it_is(self):
        dice = np.random.default_rng(4)
        group = np.repeat(np.arange(8), 200)
        a = np.tile(np.linspace(1.5, 0.2, 200), 8)
        v = np.tile(np.linspace(0.0, 2.0, 200), 8)
        level = np.repeat([3600.0, 3850.0], 800)
        errors: list[np.ndarray] = []
        stds: list[float] = []
        for _ in range(30):
            f = level * a + 2900.0 * v + dice.normal(0.0, 60.0, a.size)
            found = estimate_unit_levels(
                np.column_stack([a, v]),
                f,
                group,
                None,
                np.zeros(1),
                np.array([np.inf]),
                np.arange(8),
            )
            beta = np.linalg.solve(found.gram, found.cross)
            # the shared friction's error is common; between units of one level it cancels
            levels = found.y - found.x @ beta
            errors.append(levels - level[::200] - (levels - level[::200]).mean())
            stds.append(float(np.sqrt(found.variance).mean()))
        assert np.std(errors) == pytest.approx(np.mean(stds), rel=0.15)
