"""`payscope reproduce`: every item whole, with the paper's numbers, bounds and sentences."""

from pathlib import Path

import polars as pl
import pytest

from analysis.paper import printed_numbers
from analysis.paper.replayed_campaign import (
    compute_cramer_rao_bound_of_trial_kg,
    rerun_gate_and_estimates,
)
from analysis.simulation import Scenario
from recordings.paper.paper_items import ITEMS, ItemResult
from recordings.paper.paper_page import write_reproduction
from replay import load_machine
from replay.paper.reproduce_paper import Reproduction, replay_simulated_campaign_in_memory
from replay.simulation.simulate_logs import simulate_scenario_to_logs
from tests.replay.sledge import Payscope, join_to_one_line
from tests.twins import mark_heavy_after

TRIALS, CAMPAIGNS = 10, 2


@pytest.fixture(scope="module")
def told() -> list[str]:
    return []


@pytest.fixture(scope="module")
def reproduction() -> Reproduction:
    return Reproduction(ITEMS, windows=TRIALS, campaigns=CAMPAIGNS, seed=1)


@pytest.fixture(scope="module")
def found(reproduction: Reproduction, told: list[str]) -> dict[str, ItemResult]:
    return {each.item.name: each for each in reproduction.compute_paper_items(told.append)}


@pytest.mark.slow
def test_every_table_figure_and_claim_is_found_in_the_papers_order(
    found: dict[str, ItemResult],
) -> None:
    assert list(found) == [
        *("table1", "table2", "table3", "table4"),
        *("fig2", "fig3", "fig4", "fig5", "fig6", "fig7", "fig8"),
        "claims",
    ]
    for each in found.values():
        assert each.frame.height > 0
        assert each.sentences.choices
        assert each.sentences.findings
        for sentence in (*each.sentences.choices, *each.sentences.findings):
            assert "nan" not in sentence.lower().split(), sentence
            assert "None" not in sentence, sentence


@pytest.mark.heavy
def test_progress_is_told_as_often_as_was_promised(
    reproduction: Reproduction, found: dict[str, ItemResult], told: list[str]
) -> None:
    assert found
    assert told == [each.name for each in reproduction.repetitions]
    assert len(set(told)) == len(told)


def test_what_several_items_need_is_simulated_once() -> None:
    def names(*wanted: str) -> list[str]:
        items = [item for item in ITEMS if item.name in wanted]
        planned = Reproduction(items, windows=10, campaigns=2, seed=1)
        return [each.name for each in planned.repetitions]

    assert names("fig2", "fig3") == ["linear motion"]
    assert names("table3", "fig6", "fig8") == ["campaign 1", "campaign 2"]
    assert names("claims") == ["windows", "campaign 1", "campaign 2", "cruise 1", "cruise 2"]


def test_an_ideal_torque_chain_has_slope_one_and_the_assumed_one_explains_table_2(
    found: dict[str, ItemResult],
) -> None:
    slopes = {
        (row["chain"], row["method"]): row for row in found["table2"].frame.iter_rows(named=True)
    }
    for method in (*printed_numbers.METHODS, "pooled"):
        assert slopes["ideal", method]["alpha_1"] == pytest.approx(1.0, abs=0.06)
    printed = dict(zip(printed_numbers.METHODS, printed_numbers.TABLE_2["alpha_1"], strict=True))
    assert slopes["front_axle", "ls"]["alpha_1"] == pytest.approx(printed["ls"], abs=0.015)
    assert slopes["front_axle", "ls"]["beta_kg"] == pytest.approx(3401.4, rel=0.06)


@pytest.mark.parametrize(
    ("name", "setting", "printed"),
    [
        ("table3", "threshold_nat", printed_numbers.TABLE_3_KG),
        ("table4", "window_samples", printed_numbers.TABLE_4_KG),
    ],
)
def test_tables_3_and_4_have_every_printed_value_and_no_pooled_error_below_the_bound(
    found: dict[str, ItemResult], name: str, setting: str, printed: dict[float, tuple[float, ...]]
) -> None:
    table = found[name].frame
    assert table[setting].unique(maintain_order=True).to_list() == list(printed)
    for row in table.iter_rows(named=True):
        beside = printed_numbers.pair_table_values_with_methods(printed[row[setting]]).get(
            row["method"]
        )
        assert row["paper_kg"] == beside
        assert row["run_kg"] < row["run_left_out_kg"] < 30.0
    pooled = table.filter(pl.col("method") == "pooled")
    assert pooled["over_bound_1"].is_between(0.9, 1.3).all()


def test_a_window_that_the_gate_refuses_everywhere_has_no_bound() -> None:
    short = Scenario()
    campaign = short.campaign.model_copy(update={"loads_kg": (0.0,), "runs": 1})
    replayed = replay_simulated_campaign_in_memory(
        short.model_copy(update={"campaign": campaign}), load_machine("cat262c.toml")
    )
    assert 3.0 < compute_cramer_rao_bound_of_trial_kg(replayed) < 10.0
    refused = rerun_gate_and_estimates(
        replayed, replayed.settings.copy_with_changes({"gate.threshold_nat": 50.0})
    )
    assert compute_cramer_rao_bound_of_trial_kg(refused) != compute_cramer_rao_bound_of_trial_kg(
        refused
    )


@pytest.mark.heavy
def test_the_bound_is_the_same_to_the_last_digit_each_time() -> None:
    short = Scenario()
    campaign = short.campaign.model_copy(update={"loads_kg": (0.0, 100.0), "runs": 6})
    replayed = replay_simulated_campaign_in_memory(
        short.model_copy(update={"campaign": campaign}), load_machine("cat262c.toml")
    )
    assert len({compute_cramer_rao_bound_of_trial_kg(replayed) for _ in range(20)}) == 1


@pytest.mark.heavy
def test_a_simulation_replayed_from_memory_is_that_of_its_bags(tmp_path: Path) -> None:
    from replay.demo.run_demo import replay_simulated_campaign

    small = Scenario()
    campaign = small.campaign.model_copy(update={"loads_kg": (0.0, 250.0), "runs": 2})
    small = small.model_copy(update={"campaign": campaign})
    machine = load_machine("cat262c.toml")
    logs = simulate_scenario_to_logs(small, tmp_path / "c.bag")
    from_bags = replay_simulated_campaign(logs, machine).frames
    from_memory = replay_simulated_campaign_in_memory(small, machine).replayed.frames
    for frame in ("loads", "segments"):
        found, expected = (
            each[frame]["mass_kg"].drop_nulls().to_list() for each in (from_memory, from_bags)
        )
        assert found
        assert found == pytest.approx(expected, rel=1e-9)


def test_a_long_cruise_ruins_rls_without_the_criterion_alone(found: dict[str, ItemResult]) -> None:
    frame = found["claims"].frame
    cruise = frame.filter(pl.col("case").str.contains("cruise"))
    errors = dict(cruise.select("case", "found_kg").iter_rows())
    ungated = next(case for case in errors if case.startswith("RLS ungated, "))
    assert errors.pop(ungated) > 1000.0
    assert all(error < 40.0 for error in errors.values())


def test_rls_keeps_few_bytes_and_ols_the_window(found: dict[str, ItemResult]) -> None:
    frame = found["claims"].frame.drop_nulls("buffer_bytes")
    ls, rls = (frame.filter(pl.col("case").str.starts_with(name)) for name in ("LS", "RLS"))
    assert ls["buffer_bytes"].to_list() == [24 * n for n in (200, 300, 400, 500, 600, 700)]
    assert rls["buffer_bytes"].to_list() == [64] * 6
    for part in (ls, rls):
        assert part["found_kg"].is_between(1.0, 60.0).all()


def test_claims_are_given_of_the_payload_range_as_well(found: dict[str, ItemResult]) -> None:
    frame = found["claims"].frame
    constant = frame.filter(pl.col("case").str.contains("constant")).row(0, named=True)
    assert constant["of_mass_percent"] == pytest.approx(2.36, abs=0.01)
    assert constant["of_load_range_percent"] == pytest.approx(34.2, abs=0.1)


@pytest.mark.heavy
@pytest.mark.parametrize("output_format", mark_heavy_after(1, ["md", "csv"]))
def test_files_are_written_all_or_none(
    found: dict[str, ItemResult], tmp_path: Path, output_format: str
) -> None:
    files = write_reproduction(
        list(found.values()), tmp_path, output_format, "about it", overwrites=False
    )
    assert sorted(files) == sorted(tmp_path.iterdir())
    for name in found:
        if name.startswith("fig"):
            picture = (tmp_path / f"{name}.png").read_bytes()
            assert picture.startswith(b"\x89PNG")
            assert len(picture) < 150_000
    if output_format == "csv":
        assert pl.read_csv(tmp_path / "table1.csv").height == 65
        sentences = pl.read_csv(tmp_path / "findings.csv")
        assert set(sentences["item"].drop_nulls()) >= set(found)
        return
    page = (tmp_path / "reproduction.md").read_text(encoding="utf-8")
    for each in found.values():
        assert f"## {each.item.title}" in page
        assert all(
            f"- {line}" in page for line in (*each.sentences.findings, *each.sentences.choices)
        )
    tables = [line.count("|") for line in page.splitlines() if line.startswith("|")]
    assert min(tables) > 3
    assert "None" not in page


class TestCommand:
    @pytest.mark.heavy
    def test_one_item_alone(self, payscope: Payscope, tmp_path: Path) -> None:
        said = payscope("reproduce", "fig2", "-o", tmp_path / "out")
        assert said.status == 0
        assert said.out.split() == [
            str(tmp_path / "out" / name) for name in ("reproduction.md", "fig2.png")
        ]
        join_to_one_line(payscope("reproduce", "fig2", "-o", tmp_path / "out"), "--force")
        assert payscope("reproduce", "fig2", "-o", tmp_path / "out", "--force").status == 0

    def test_an_unknown_item_names_the_nearest(self, payscope: Payscope, tmp_path: Path) -> None:
        join_to_one_line(
            payscope("reproduce", "tabel1", "-o", tmp_path / "out"), "did you mean 'table1'?"
        )
        assert not (tmp_path / "out").exists()

    def test_a_folder_that_cannot_be_made(self, payscope: Payscope, tmp_path: Path) -> None:
        (tmp_path / "file").write_text("")
        join_to_one_line(payscope("reproduce", "fig2", "-o", tmp_path / "file" / "out"), "file")
