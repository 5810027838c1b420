"""Spins are followed as straight motion is: decisions and inertia as the causal replay has them."""

from pathlib import Path

import pytest

from analysis.model.machine import Channel, Machine
from analysis.online.follower import FollowedRow
from analysis.online.online_report import OnlineReport
from analysis.simulation import Scenario
from replay import load_machine, open_log, run
from replay.follow.agreement import FollowedDigests
from replay.follow.follow_logs import FollowedLogState, follow_logs
from replay.follow.report_file import describe_finished_manoeuvre
from replay.simulation.simulate_logs import simulate_scenario_to_logs

#: Straight motion each way, spins and an arc: what every axis has to refuse is there.
TURNING = Scenario.model_validate(
    {
        "campaign": {
            "loads_kg": [150],
            "runs": 1,
            "manoeuvres": [
                {"kind": "rest", "duration_s": 1.5},
                {"kind": "start"},
                {"kind": "spin"},
                {"kind": "spin"},
                {"kind": "arc", "speed_m_s": 0.8, "yaw_rate_rad_s": 0.3, "duration_s": 4.0},
            ],
        }
    }
)
CAUSAL = [
    "settings.filter.causal=true",
    "settings.noise.force_N=60.0",
    "settings.noise.acc_m_s2=0.01",
    "settings.noise.speed_m_s=0.005",
    "settings.noise.torque_z_N_m=45.0",
    "settings.noise.yaw_acc_rad_s2=0.026",
    "settings.noise.yaw_rate_rad_s=0.001",
]


@pytest.fixture(scope="module")
def turning(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return simulate_scenario_to_logs(TURNING, tmp_path_factory.mktemp("turning") / "turning.mcap")[
        0
    ]


@pytest.fixture(scope="module")
def machine() -> Machine:
    loader = load_machine("cat262c.toml", CAUSAL)
    derived = Channel(derive="d/dt yaw_rate_rad_s")
    return loader.model_copy(update={"channels": {**loader.channels, "yaw_acc_rad_s2": derived}})


@pytest.mark.heavy
def test_spins_agree_with_the_causal_replay_and_are_reported(
    turning: Path, machine: Machine
) -> None:
    digests, reports = FollowedDigests(), list[OnlineReport]()

    def take(_: FollowedLogState, rows: list[FollowedRow]) -> None:
        digests.add_followed_rows(rows)
        reports.extend(report for row in rows for report in row.reports)

    follow_logs([turning], machine, take, idle_s=0.1)
    with open_log(turning) as log:
        agreements = {
            each.name: each
            for each in digests.compare_with_replayed_frames(run(log, machine).frames)
        }
    assert {"gate", "gate of spins", "pooled", "pooled of spins", "rls of spins"} <= set(agreements)
    # the yaw acceleration is derived, which agrees to rounding
    assert all(each.is_rounding and each.rows == each.replayed for each in agreements.values())
    assert agreements["pooled of spins"].rows == 2
    spins = [report for report in reports if report.event == "spin"]
    assert [report.spins for report in spins] == [1, 2]
    for report in spins:
        assert report.inertia_z_kg_m2 == pytest.approx(4353.0, rel=0.03)
        assert "kg·m²" in describe_finished_manoeuvre(report)
    for report in reports:
        is_told = report.spin_validity in ("valid", "old")
        assert (report.inertia_z_kg_m2 is not None) == is_told
        assert (report.inertia_u_kg_m2 is not None) == is_told
