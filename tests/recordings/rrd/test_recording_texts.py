"""The texts: the answer first, and why there is none."""

import polars as pl

from analysis import Run
from analysis.model.answer import make_answer
from analysis.model.loss import Loss
from recordings.report.planar_text import describe_planar_fits
from recordings.rrd.recording_texts import (
    format_answer_headline,
    format_answer_summary,
    format_number,
    format_plus_minus,
    make_recording_name,
    make_texts_of_run,
)


def test_the_answer_begins_with_the_mass_of_the_load_and_what_its_uncertainty_is(drives):
    run = drives(60.0)
    told = "3500 ± 41 kg (standard uncertainty, scale error not included)"
    assert format_answer_headline(make_answer(run)) == told
    assert make_texts_of_run(run)["answer"].startswith(f"# {told}")
    scaled = run.frames["loads"].with_columns(scale_unknown=pl.lit(""))
    known = Run({**run.frames, "loads": scaled}, run.provenance)
    assert format_answer_headline(make_answer(known)) == "3500 ± 41 kg (standard uncertainty)"


def test_a_run_without_loads_begins_with_the_pooled_mass_and_says_whose_deviation_it_is(drives):
    """As recordings from before the joint fit are."""
    run = drives(60.0)
    kept = {n: f for n, f in run.frames.items() if n not in ("loads", "nuisances", "budget")}
    mass, std = run.frames["masses"].filter(method="pooled").row(0)[1:3]
    told = format_answer_headline(make_answer(Run(kept, run.provenance)))
    assert told == f"{mass:.0f} ± {std:.0f} kg (pooled, statistical standard deviation)"


def test_a_check_that_fails_and_withholds_nothing_is_not_called_failed(drives):
    run = drives(60.0)
    judged = run.frames["verdict"].with_columns(
        passed=pl.Series([False, False, True]), consequence=pl.Series(["widen", "tell", "withhold"])
    )
    told = Run({**run.frames, "verdict": judged}, run.provenance)
    assert format_answer_headline(make_answer(told)) == format_answer_headline(make_answer(run))
    assert "failed" not in make_texts_of_run(told)["answer"]
    assert "- widened: **partial_correlation**" in make_texts_of_run(told)["answer"]
    assert "note     relative_std" in format_answer_summary(told)
    assert "FAILED" not in format_answer_summary(told)


def test_a_withheld_mass_says_which_checks_failed_with_number_and_limit(drives):
    told = make_texts_of_run(drives(60.0, passed=False))["answer"]
    assert told.startswith("# This log cannot weigh the machine")
    assert "**The mass is withheld**" in told
    assert "**partial_correlation** is 0.12, must be ≥ 0.5: how well" in told
    assert "**relative_std** is 0.8, must be ≤ 0.25" in told


def test_what_is_not_known_of_the_scale_has_no_unit(drives):
    told = make_texts_of_run(drives(60.0))["answer"]
    assert "- **force_gain** (scale): not known; shrinks with known loads" in told
    assert "- **noise** (random): 9 kg = 5%; shrinks with more starts" in told


def test_a_ratio_among_the_terms_has_no_unit_behind_it(drives):
    run = drives(60.0)
    ratio = run.frames["nuisances"].with_columns(unit=pl.Series(["1", "s"]))
    told = make_texts_of_run(Run({**run.frames, "nuisances": ratio}, run.provenance))["answer"]
    assert "120 ± 40, prior ± 300; u of the mass 12 kg" in told
    assert "-0.0030 ± 0.0010 s, prior ± 0.02 s;" in told


def test_a_log_without_an_accepted_window_says_so(drives):
    assert "there is no mass" in format_answer_headline(make_answer(drives(60.0, accepted=False)))


def test_every_check_is_listed_also_one_that_does_not_apply(drives):
    told = make_texts_of_run(drives(60.0))["answer"]
    assert "does not apply: **acceleration_gain** – (0.5 … 2)" in told
    assert "passed: **partial_correlation** 0.93 (≥ 0.5)" in told


def test_a_person_reads_the_local_time_of_the_machine(drives):
    written = make_texts_of_run(drives(60.0))["answer"]
    assert "2023-11-14 19:13:20 -03:00 America/Santiago" in written
    assert "Times on the axes are UTC, unless the viewer's settings say local time." in written


def test_a_clock_that_counts_from_its_start_is_given_no_date(drives):
    run = drives(60.0)
    about = run.provenance.model_copy(update={"t0_unix_ns": 47_580_000_000})
    written = make_texts_of_run(Run(run.frames, about))["answer"]
    assert "47.580 s of the log's own clock" in written
    assert "1970" not in written
    assert "Times on the axes are those of the log's own clock" in written
    assert "UTC" not in written


def test_nothing_of_a_calibration_is_cut_off_at_the_side(drives):
    written = make_texts_of_run(drives(60.0))["calibration"]
    (head,) = (line for line in written.splitlines() if "reference kg" in line)
    assert head.count("|") == 7
    assert "| ls | 0 |" in written


def test_what_turning_is_worth_is_a_list_that_wraps(drives):
    rows = {
        "quantity": ["inertia_z_kg_m2", "com_x_m"],
        "cause": ["noise", "track_width"],
        "kind": ["random", "scale"],
        "u": [8.7, None],
        "unit": ["kg·m²", "m"],
        "share_1": [0.4, None],
        "meaning": ["", ""],
        "shrinks": ["more turns", "measuring it"],
    }
    run = drives(60.0)
    written = make_texts_of_run(Run({**run.frames, "planar_budget": pl.DataFrame(rows)}))["planar"]
    assert "- **noise** (random): 8.7 kg·m²; shrinks with more turns" in written
    assert "- **track_width** (scale): not known; shrinks with measuring it" in written


def test_a_loss_of_a_whole_file_has_no_topic():
    assert str(Loss(source="shift.bag", what="breaks off")) == "shift.bag: breaks off"


def test_losses_and_notes_stand_in_the_answer_and_inputs_with_their_hash_in_the_provenance(drives):
    written = make_texts_of_run(drives(60.0))
    assert "lost: shift.bag /imu: 3 messages could not be decoded" in written["answer"]
    assert "force share" in written["answer"]
    assert "ab" * 32 in written["provenance"]
    assert "| verdict.partial_correlation_min | 0.5 |" in written["settings"]
    assert '"empty_mass_kg": 2850.0' in written["settings"]


def test_the_calibration_is_written_only_where_there_is_one(drives):
    assert "reference = " in make_texts_of_run(drives(60.0))["calibration"]
    assert "calibration" not in make_texts_of_run(drives(60.0, calibration=False))


def test_a_run_of_nothing_still_has_its_texts():
    written = make_texts_of_run(Run({}))
    assert set(written) == {"answer", "settings", "provenance"}
    assert make_recording_name(Run({}).provenance) == "payscope"
    # also a log without an accepted window has checks: without them the answer is what is missing
    assert format_answer_summary(Run({"masses": pl.DataFrame()})).startswith(
        "This recording contains no answer."
    )


def test_numbers_are_short_and_a_value_ends_where_its_standard_deviation_does():
    assert [format_number(x) for x in (None, True, 12345.6, 0.123456, "a")] == [
        "–",
        "yes",
        "12\u202f346",
        "0.1235",
        "a",
    ]
    assert format_plus_minus(3517.93, 24.86) == "3518 ± 25"
    assert format_plus_minus(1.23456, 0.0123) == "1.235 ± 0.012"
    assert format_plus_minus(3517.93, None) == "3518"


def test_the_centre_of_mass_is_told_with_its_deviation_and_what_the_motion_determines(drives):
    written = make_texts_of_run(drives(60.0))
    line = "centre of mass from all motion together: 0.1300 ± 0.0040 m ahead of the origin"
    assert line in written["answer"]
    assert line in format_answer_summary(drives(60.0))
    assert "together only mass_kg - 5 first_moment_y_kg_m" in written["planar"]
    assert "| arc | 5.00 – 9.00 |" in written["planar"]


def test_a_centre_of_mass_behind_and_to_the_right_is_told_without_a_sign():
    row = {"com_x_m": -0.2, "com_x_std_m": 0.01, "com_y_m": -0.05, "com_y_std_m": 0.01}
    told = describe_planar_fits([{"kind": "joint", "withheld": False, **row}])
    where = "0.200 ± 0.010 m behind the origin, 0.050 ± 0.010 m to its right"
    assert told == [f"centre of mass from all motion together: {where}"]


def test_a_withheld_centre_of_mass_has_no_number(drives):
    written = make_texts_of_run(drives(60.0, passed=False))
    assert "centre of mass from all motion together: withheld" in written["answer"]
    assert "0.13" not in written["planar"]


def test_a_failed_check_of_the_inertia_withholds_the_inertia_and_not_the_mass(drives):
    run = drives(60.0)
    spin = (
        run.frames["verdict"]
        .head(1)
        .with_columns(
            check=pl.lit("spin_partial_correlation"), about=pl.lit("inertia"), passed=pl.lit(False)
        )
    )
    judged = pl.concat([run.frames["verdict"], spin])
    failing = Run({**run.frames, "verdict": judged}, run.provenance)
    assert format_answer_headline(make_answer(failing)) == format_answer_headline(make_answer(run))
    assert "**The yaw inertia is withheld**" in make_texts_of_run(failing)["answer"]
    assert "**The yaw inertia is withheld**" not in make_texts_of_run(run)["answer"]


def test_a_run_that_does_not_turn_has_no_page_about_its_centre_of_mass(drives):
    run = drives(60.0)
    straight = Run({**run.frames, "planar": run.frames["planar"].clear()}, run.provenance)
    assert "planar" not in make_texts_of_run(straight)
    assert "centre of mass" not in format_answer_summary(straight)
