"""A load that pours on the haul: what arrives at the dump is paid, what sets off is weighed."""

import numpy as np
import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st
from polars.testing import assert_frame_equal

from analysis.cycles.calibrated_payloads import calibrate_cycles
from analysis.cycles.cycle_parts import CycleParts
from analysis.cycles.cycles import weigh_cycles
from analysis.cycles.haul_spillage import compute_arriving_fraction_and_u, subtract_spillage
from analysis.cycles.load_passes import LoadPasses
from analysis.cycles.shift_totals import make_shift_totals_frame
from analysis.model.machine import Machine
from analysis.model.machine_body import Body
from tests.analysis.cycles.drawn import NS, drawn_shift
from tests.analysis.cycles.test_calibrated_or_ticket import LINE
from tests.analysis.cycles.test_cycles import FINE, MACHINE, found

SHARES = st.floats(0.0, 0.9)
LOADS_KG = [700.0, 650.0, 720.0, 690.0]


def body(share: float | None, u: float | None = None) -> Body:
    return MACHINE.machine.model_copy(update={"haul_spillage_share": share, "haul_spillage_u": u})


def spilling(share: float | None, u: float | None = None) -> Machine:
    return MACHINE.model_copy(update={"machine": body(share, u)})


@given(SHARES, st.floats(0.0, 1.0), st.floats(0.0, 0.2))
def test_a_load_weighed_under_way_arrives_with_what_has_not_poured_yet(
    share: float, progress: float, u: float
) -> None:
    arriving, _ = compute_arriving_fraction_and_u(np.array([0.0, progress, 1.0]), body(share, u))
    assert arriving[0] == pytest.approx(1.0 - share)
    assert arriving[2] == pytest.approx(1.0)
    load_kg = 1000.0
    weighed_kg = load_kg * (1.0 - share * progress)
    assert arriving[1] * weighed_kg == pytest.approx(load_kg * (1.0 - share))


@given(SHARES, st.floats(0.0, 1.0))
def test_its_uncertainty_is_the_slope_by_the_stated_share(share: float, progress: float) -> None:
    at = np.array([progress])
    step, u = 1e-6, 0.03
    slope = (
        compute_arriving_fraction_and_u(at, body(share + step))[0]
        - compute_arriving_fraction_and_u(at, body(share))[0]
    ) / step
    by_place = compute_arriving_fraction_and_u(at, body(share, 0.0))[1]
    whole = compute_arriving_fraction_and_u(at, body(share, u))[1]
    assert whole == pytest.approx(np.hypot(slope * u, by_place), rel=1e-4, abs=1e-9)


def test_a_load_that_pours_is_paid_as_it_arrives_and_the_total_is_as_uncertain_as_the_share() -> (
    None
):
    frames = drawn_shift(LOADS_KG)
    plain = found(frames)
    poured = weigh_cycles(None, frames, spilling(0.2, 0.03), FINE).cycles
    # each haul has two starts: at its beginning, and more than half way
    arriving = poured["arriving_1"].to_numpy()
    assert ((arriving > 0.8) & (arriving < 0.9)).all()
    assert poured["payload_kg"].to_list() == pytest.approx((arriving * LOADS_KG).tolist())
    summed = make_shift_totals_frame(poured, frames["excitation"], frames["aligned"]).row(
        0, named=True
    )
    spilled_u_kg = float((poured["arriving_u_1"].to_numpy() * LOADS_KG).sum())
    assert summed["payload_u_common_kg"] == pytest.approx(spilled_u_kg)
    assert spilled_u_kg > 0.03 * (1 - 0.9) * sum(LOADS_KG)
    own = make_shift_totals_frame(plain, frames["excitation"], frames["aligned"]).row(0, named=True)
    assert summed["payload_u_random_kg"] == pytest.approx(arriving[0] * own["payload_u_random_kg"])


def test_without_a_stated_share_nothing_is_subtracted() -> None:
    assert found(drawn_shift(LOADS_KG))["arriving_1"].is_null().all()


def test_a_calibrated_payload_arrives_likewise() -> None:
    frames = drawn_shift([200.0] * 5)
    plain = calibrate_cycles(found(frames), LINE)
    poured = calibrate_cycles(weigh_cycles(None, frames, spilling(0.2, 0.0), FINE).cycles, LINE)
    kept = ["payload_kg", "payload_u_random_kg", "scale_1"]
    arriving = poured["arriving_1"]
    assert (arriving < 1.0).all()
    assert_frame_equal(poured.select(kept), plain.select(pl.col(kept) * arriving))
    assert poured["scale_from"].to_list() == plain["scale_from"].to_list()


def test_a_haul_of_two_starts_is_weighed_between_them() -> None:
    """Ten seconds of driving, sped up in the first and in the sixth: weighed at a quarter."""
    seconds = np.arange(12.0)
    frames = drawn_shift([700.0])
    table = found(frames)
    excitation = pl.DataFrame(
        {
            "t_ns": (seconds * NS).astype(np.int64),
            "phase": ["standstill", *["cruising"] * 10, "standstill"],
            "regressor_acc_x_m_s2": [0.0, 1.0, *[0.0] * 4, 1.0, *[0.0] * 5],
        }
    )
    starts = pl.DataFrame({"start_t_ns": [NS, 6 * NS], "end_t_ns": [5 * NS, 10 * NS]})
    part = CycleParts(loaded_pass=0, haul_ns=(NS, 10 * NS), dump_ns=(11 * NS, 11 * NS))
    frames = {"excitation": excitation, "manoeuvres": starts}
    share = 0.2

    def arriving(weights: list[float]) -> float:
        weighed = LoadPasses(
            pass_of_manoeuvre=np.zeros(2, np.int64),
            share=np.array(weights),
            loaded=np.array([True]),
            mass_kg=np.array([4300.0]),
            u_kg=np.array([10.0]),
            start_ns=np.array([NS]),
            end_ns=np.array([10 * NS]),
        )
        poured = subtract_spillage(table, [part], weighed, frames, body(share, 0.0))
        return float(poured["arriving_1"][0])

    progress = (0.0 + 5.0) / 2.0 / 9.0
    assert arriving([0.5, 0.5]) == pytest.approx((1 - share) / (1 - share * progress))
    # a first start whose load was heavier than the last weighs nothing
    assert arriving([0.0, 1.0]) == pytest.approx((1 - share) / (1 - share * 5.0 / 9.0))
