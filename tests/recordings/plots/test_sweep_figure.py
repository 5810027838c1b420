"""The figure of a sweep: what stands where, and what is said where nothing is."""

import numpy as np
import pytest

from recordings.plots.sweep_figure import SweptRow, draw_sweep_figure

METHODS = ("ls", "rls", "fgls", "tls", "pooled", "joint")


def row(value: float, mass_kg: float | None = 100.0) -> SweptRow:
    return SweptRow(
        over={"threshold_nat": value},
        mass_kg=dict.fromkeys(METHODS, mass_kg),
        mass_std_kg=dict.fromkeys(METHODS, 1.0),
        payload_kg=None,
        errors={"error (kg)": dict.fromkeys(METHODS, mass_kg)},
        accepted_share_1=0.5,
        can_weigh=mass_kg is not None,
    )


@pytest.mark.parametrize("values", [(0.5, 1.0, 1.5), (0.7,)])
def test_the_answer_stands_at_its_value_and_the_other_methods_near_it(
    values: tuple[float, ...],
) -> None:
    mass = draw_sweep_figure([row(value) for value in values]).axes[0]
    drawn = {str(bars.get_label()): np.asarray(bars[0].get_xdata()) for bars in mass.containers}
    assert set(drawn) == set(METHODS)
    np.testing.assert_allclose(drawn["joint"], values)
    step = values[1] - values[0] if len(values) > 1 else 1.0
    firsts = sorted(float(at[0]) for at in drawn.values())
    assert len(set(firsts)) == len(METHODS)
    assert max(abs(at - values[0]) for at in firsts) <= 0.1 * step


def test_one_value_alone_is_the_only_tick() -> None:
    last = draw_sweep_figure([row(0.7)]).axes[-1]
    assert list(last.get_xticks()) == [0.7]


def test_panels_without_a_mass_say_so() -> None:
    *panels, _ = draw_sweep_figure([row(50.0, None), row(60.0, None)]).axes
    assert len(panels) == 2
    for axes in panels:
        assert [text.get_text() for text in axes.texts] == ["no mass"]
        assert list(axes.get_yticks()) == []
