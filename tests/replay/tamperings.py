"""What an attacker without the key may do to a bundle, one change each."""

import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import polars as pl

from analysis.calibration.use.learnt_priors import learnt_terms
from recordings.calibration.bundle_folder import EVIDENCE, POINTS, READINGS, RECORDING, REPORT, SUMS
from recordings.calibration.check_outcomes import BundleOutcome
from recordings.calibration.derived_values import estimator_of
from recordings.calibration.evidence_document import document_of
from recordings.signatures.canonical_json import canonical
from tests.replay.attacker import Bundle, Tamper

TAMPERED, IRREPRODUCIBLE = BundleOutcome.TAMPERED, BundleOutcome.IRREPRODUCIBLE
INCOMPLETE = BundleOutcome.INCOMPLETE


def in_evidence(*place: str | int, to: Any) -> Tamper:
    """Set a value of evidence.json, or change it by a function."""

    def tamper(bundle: Bundle) -> None:
        inside: Any = bundle.evidence
        for name in place[:-1]:
            inside = inside[name]
        value = to(inside[place[-1]]) if callable(to) else to
        assert value != inside[place[-1]]
        inside[place[-1]] = value

    return tamper


def fit(*place: str | int) -> Tamper:
    """A digit of the fit."""
    return in_evidence("calibration", *place, to=lambda x: (x or 0.0) * 1.01 + 1e-3)


def reading(number: int, **values: Any) -> Tamper:
    return lambda bundle: bundle.reading(number, **values)


def of_bytes(name: str, change: Callable[[bytes], bytes]) -> Tamper:
    return lambda bundle: bundle.bytes_of.update({name: change})


def at_last(step: Callable[[Path], object]) -> Tamper:
    return lambda bundle: bundle.last.append(step)  # pyright: ignore


def without_run(bundle: Bundle) -> None:
    (gone,) = [run["id"] for run in bundle.evidence["campaign"]["runs"][1:2]]
    bundle.readings = bundle.readings.filter(pl.col("run_id") != gone)
    bundle.points = bundle.points.filter(pl.col("run_id") != gone)


def without_run_anywhere(bundle: Bundle) -> None:
    without_run(bundle)
    log = bundle.evidence["campaign"]["runs"].pop(1)["log"]
    bundle.evidence["logs"] = [each for each in bundle.evidence["logs"] if each["log"] != log]


def swapped_logs(bundle: Bundle) -> None:
    first, second = bundle.evidence["logs"][:2]
    first["files"], second["files"] = second["files"], first["files"]


def without_reading(bundle: Bundle) -> None:
    bundle.readings = bundle.readings[1:]


def one_reading_more(bundle: Bundle) -> None:
    last = bundle.readings[-1:].with_columns(pl.col("reading") + 1)
    bundle.readings = pl.concat([bundle.readings, last])


def another_mass(bundle: Bundle) -> None:
    number = bundle.readings["mass_kg"][2] + 0.1
    bundle.reading(2, mass_kg=number)


def moved_point(bundle: Bundle) -> None:
    bundle.points = bundle.points.with_columns(pl.col("error_kg") / 10.0)


def edited_report(data: bytes) -> bytes:
    changed = data.replace(b"Not for trade.", b"For trade.", 1)
    assert changed != data
    return changed


def link(folder: Path) -> None:
    (folder / REPORT).rename(folder.parent / f"{folder.name}.html")
    (folder / REPORT).symlink_to(folder.parent / f"{folder.name}.html")


def dropped_sum(folder: Path) -> None:
    lines = (folder / SUMS).read_text().splitlines(keepends=True)
    (folder / SUMS).write_text("".join(lines[1:]))


def relearnt(bundle: Bundle) -> None:
    """Narrow what a log said, and let everything that follows from it follow."""
    for each in bundle.evidence["learnt"]["logs"]:
        if each["term"] == "const":
            each["posterior"] *= 1.1
    document = document_of(canonical(bundle.evidence), EVIDENCE)
    assert document.learnt is not None
    terms = learnt_terms(document.learnt.logs)
    bundle.evidence["learnt"]["terms"] = {
        name: term.model_dump(mode="json") for name, term in terms.items()
    }
    document = document_of(canonical(bundle.evidence), EVIDENCE)
    estimator = estimator_of(document.campaign, document.weighing)
    bundle.evidence["estimator"] = estimator.model_dump(mode="json")


def compressed(data: bytes) -> bytes:
    out = io.BytesIO()
    pl.read_parquet(io.BytesIO(data)).write_parquet(out, compression="zstd")
    return out.getvalue()


#: name: the change; what is found where key and earlier evidence are given; what is found with
#: neither, once the attacker has taken the signature off (None: nothing can be).
TAMPERINGS: dict[str, tuple[Tamper, BundleOutcome, BundleOutcome | None]] = {
    "alpha": (fit("alpha_1"), TAMPERED, IRREPRODUCIBLE),
    "beta": (fit("beta_kg"), TAMPERED, IRREPRODUCIBLE),
    "slope": (fit("c1_1"), TAMPERED, IRREPRODUCIBLE),
    "a digit of the covariance": (fit("covariance", 1), TAMPERED, IRREPRODUCIBLE),
    "chi squared": (fit("chi2_1"), TAMPERED, IRREPRODUCIBLE),
    "the uncertainty": (fit("u_kg"), TAMPERED, IRREPRODUCIBLE),
    "the coverage factor": (fit("coverage_k_1"), TAMPERED, IRREPRODUCIBLE),
    "the valid range": (fit("range_kg", 1), TAMPERED, IRREPRODUCIBLE),
    "a row of the budget": (fit("budget", 0, "u_kg"), TAMPERED, IRREPRODUCIBLE),
    "an error of a point": (fit("points", 2, "error_kg"), TAMPERED, IRREPRODUCIBLE),
    "a sentence": (in_evidence("calibration", "says", to=[]), TAMPERED, IRREPRODUCIBLE),
    "the confidence": (in_evidence("options", "confidence_1", to=0.5), TAMPERED, IRREPRODUCIBLE),
    "the verdict's risk": (in_evidence("limits", "risk_1", to=0.5), TAMPERED, IRREPRODUCIBLE),
    "the asked class": (
        in_evidence("campaign", "decision", "accuracy_class", to="OIML R 134 0.2"),
        TAMPERED,
        IRREPRODUCIBLE,
    ),
    "the verdict": (in_evidence("limits", "verdict", to="outside"), TAMPERED, IRREPRODUCIBLE),
    "the last day": (
        in_evidence("expires", to="2035-01-01"),
        TAMPERED,
        IRREPRODUCIBLE,
    ),
    "the intended use": (
        in_evidence("campaign", "campaign", "intended_use", to="trade"),
        TAMPERED,
        None,
    ),
    "the author": (in_evidence("campaign", "campaign", "author", to="N. N."), TAMPERED, None),
    "the notice": (in_evidence("notice", to="Legal for trade."), TAMPERED, TAMPERED),
    "an unknown key": (lambda b: b.evidence.update(more=1), TAMPERED, TAMPERED),
    "a number as text": (in_evidence("chain", "counter", to="2"), TAMPERED, TAMPERED),
    "the machine's id": (
        in_evidence("campaign", "machine", "id", to="sledge-8"),
        TAMPERED,
        IRREPRODUCIBLE,
    ),
    "a part": (
        in_evidence("campaign", "machine", "parts", "runners", to="R-2"),
        TAMPERED,
        None,
    ),
    "the machine's mass": (
        in_evidence("machine", "machine", "empty_mass_kg", to=101.0),
        TAMPERED,
        IRREPRODUCIBLE,
    ),
    "a setting": (
        in_evidence("machine", "settings", "gate", "window_samples", to=300),
        TAMPERED,
        IRREPRODUCIBLE,
    ),
    "a channel's scale": (
        in_evidence("machine", "channels", "force_x_N", "scale", to=1.1),
        TAMPERED,
        IRREPRODUCIBLE,
    ),
    "a reference mass": (
        in_evidence("campaign", "masses", 0, "value_kg", to=21.0),
        TAMPERED,
        IRREPRODUCIBLE,
    ),
    "a mass' uncertainty": (
        in_evidence("campaign", "masses", 0, "u_kg", to=0.011),
        TAMPERED,
        IRREPRODUCIBLE,
    ),
    "what masses share": (
        in_evidence("campaign", "masses", 1, "shared_u_kg", to=0.0),
        TAMPERED,
        IRREPRODUCIBLE,
    ),
    "a certificate": (
        in_evidence("campaign", "masses", 0, "certificate", to="K-9"),
        TAMPERED,
        None,
    ),
    "an expired certificate": (
        in_evidence("campaign", "masses", 0, "expires", to="2026-01-01"),
        TAMPERED,
        INCOMPLETE,
    ),
    "the references": (
        in_evidence("references", 1, "reference_kg", to=121.0),
        TAMPERED,
        IRREPRODUCIBLE,
    ),
    "the day of a run": (
        in_evidence("campaign", "runs", 0, "day", to="2026-05-03"),
        TAMPERED,
        IRREPRODUCIBLE,
    ),
    "a load on board": (
        in_evidence("campaign", "runs", 1, "loads", to=["block-2"]),
        TAMPERED,
        IRREPRODUCIBLE,
    ),
    "a run excluded afterwards": (
        in_evidence("campaign", "runs", 2, "excluded", to="wheel slip"),
        TAMPERED,
        IRREPRODUCIBLE,
    ),
    "the operator": (
        in_evidence("campaign", "runs", 0, "operator", to="N. N."),
        TAMPERED,
        None,
    ),
    "a dropped run": (without_run, TAMPERED, INCOMPLETE),
    "a run dropped everywhere": (without_run_anywhere, TAMPERED, IRREPRODUCIBLE),
    "swapped logs": (swapped_logs, TAMPERED, None),
    "a log's digest": (
        in_evidence("logs", 0, "files", 0, "sha256", to="0" * 64),
        TAMPERED,
        None,
    ),
    "the mean of a prior that was learnt": (
        in_evidence("learnt", "terms", "const", "mean", to=lambda x: x + 1.0),
        TAMPERED,
        IRREPRODUCIBLE,
    ),
    "the width of one": (
        in_evidence("learnt", "terms", "const", "std", to=lambda x: x * 0.5),
        TAMPERED,
        IRREPRODUCIBLE,
    ),
    "one that was not learnt": (
        lambda b: b.evidence["learnt"]["terms"].update(
            const_yaw={"mean": 0.0, "std": 1.0, "mean_u": 1.0}
        ),
        TAMPERED,
        TAMPERED,
    ),
    "what a log said of a nuisance": (
        in_evidence("learnt", "logs", 0, "posterior", to=lambda x: x + 0.01),
        TAMPERED,
        IRREPRODUCIBLE,
    ),
    "what a log said left out": (
        lambda b: b.evidence["learnt"]["logs"].pop(0),
        TAMPERED,
        IRREPRODUCIBLE,
    ),
    "what another log said": (
        in_evidence("learnt", "logs", 0, "log", to="load-9.csv"),
        TAMPERED,
        IRREPRODUCIBLE,
    ),
    "nothing learnt": (in_evidence("learnt", to=None), TAMPERED, IRREPRODUCIBLE),
    "priors made narrow throughout": (relearnt, TAMPERED, None),
    "a log that could not weigh": (
        in_evidence("logs", 0, "can_weigh", to=False),
        TAMPERED,
        IRREPRODUCIBLE,
    ),
    "the mass of a reading": (another_mass, TAMPERED, IRREPRODUCIBLE),
    "a dropped reading": (without_reading, TAMPERED, IRREPRODUCIBLE),
    "a reading more": (one_reading_more, TAMPERED, IRREPRODUCIBLE),
    "a reading rejected without a reason": (reading(0, used=False), TAMPERED, INCOMPLETE),
    "a reading rejected with one": (
        reading(0, used=False, reason="outlier"),
        TAMPERED,
        IRREPRODUCIBLE,
    ),
    "a reading of another log": (reading(0, log="load-9.csv"), TAMPERED, IRREPRODUCIBLE),
    "the points": (moved_point, TAMPERED, IRREPRODUCIBLE),
    "the line before": (
        in_evidence("as_found", "alpha_1", to=lambda x: x * 1.01),
        TAMPERED,
        IRREPRODUCIBLE,
    ),
    "the counter": (in_evidence("chain", "counter", to=7), TAMPERED, TAMPERED),
    "the link": (
        in_evidence("chain", "previous", "sums_sha256", to="0" * 64),
        TAMPERED,
        None,
    ),
    "no link": (
        lambda b: b.evidence.update(chain={"counter": 1, "previous": None}),
        TAMPERED,
        None,
    ),
    "a tolerance that forgives": (
        in_evidence("replay_tolerance_kg", to=1e9),
        TAMPERED,
        TAMPERED,
    ),
    "the software": (in_evidence("software", "python", to="4.0.0"), TAMPERED, None),
    "an edited report": (of_bytes(REPORT, edited_report), TAMPERED, TAMPERED),
    "a removed report": (at_last(lambda f: (f / REPORT).unlink()), INCOMPLETE, INCOMPLETE),
    "removed points": (at_last(lambda f: (f / POINTS).unlink()), INCOMPLETE, INCOMPLETE),
    "removed digests": (at_last(lambda f: (f / SUMS).unlink()), INCOMPLETE, INCOMPLETE),
    "one digest removed": (at_last(dropped_sum), TAMPERED, TAMPERED),
    "a renamed file": (
        at_last(lambda f: (f / REPORT).rename(f / "report.htm")),
        TAMPERED,
        TAMPERED,
    ),
    "an added file": (at_last(lambda f: (f / "note.txt").write_text("n")), TAMPERED, TAMPERED),
    "an added folder": (at_last(lambda f: (f / "more").mkdir()), TAMPERED, TAMPERED),
    "an added recording": (
        lambda b: ((b.folder / "runs").mkdir(), (b.folder / "runs/x.rrd").write_bytes(b"RRF2")),
        TAMPERED,
        TAMPERED,
    ),
    "a link": (at_last(link), TAMPERED, TAMPERED),
    "a line end": (of_bytes(EVIDENCE, lambda data: data + b"\n"), TAMPERED, TAMPERED),
    "spaces": (
        of_bytes(EVIDENCE, lambda data: data.replace(b'{"', b'{ "', 1)),
        TAMPERED,
        TAMPERED,
    ),
    "a compressed table": (
        of_bytes(READINGS, lambda data: compressed(data)),
        TAMPERED,
        TAMPERED,
    ),
    "another recording": (
        of_bytes(RECORDING, lambda data: data + b"\0"),
        TAMPERED,
        None,
    ),
}
