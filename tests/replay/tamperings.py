"""What an attacker without the key may do to a bundle, one change each."""

import io
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import polars as pl

from analysis.calibration.use.learnt_priors import pool_learnt_terms_over_logs
from recordings.calibration.bundle_folder import EVIDENCE, POINTS, READINGS, RECORDING, REPORT, SUMS
from recordings.calibration.check_outcomes import BundleOutcome
from recordings.calibration.derived_values import make_estimator_with_digest
from recordings.calibration.evidence_document import parse_untrusted_evidence
from recordings.signatures.canonical_json import encode_canonical_json
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
    document = parse_untrusted_evidence(encode_canonical_json(bundle.evidence), EVIDENCE)
    assert document.learnt is not None
    terms = pool_learnt_terms_over_logs(document.learnt.logs)
    bundle.evidence["learnt"]["terms"] = {
        name: term.model_dump(mode="json") for name, term in terms.items()
    }
    document = parse_untrusted_evidence(encode_canonical_json(bundle.evidence), EVIDENCE)
    estimator = make_estimator_with_digest(document.campaign, document.weighing_machine)
    bundle.evidence["estimator"] = estimator.model_dump(mode="json")


def compressed(data: bytes) -> bytes:
    out = io.BytesIO()
    pl.read_parquet(io.BytesIO(data)).write_parquet(out, compression="zstd")
    return out.getvalue()


class Tampering(NamedTuple):
    """One change of a bundle.

    Attributes:
        tamper: the change.
        outcome: what is found where key and earlier evidence are given.
        unsigned_outcome: what is found with neither, once the attacker has taken the signature off;
            None where nothing can be.
        kind: of what is changed.
        words: what is said of it where key and earlier evidence are given.
    """

    tamper: Tamper
    outcome: BundleOutcome
    unsigned_outcome: BundleOutcome | None
    kind: str
    words: str


TAMPERINGS: dict[str, Tampering] = {
    "alpha": Tampering(fit("alpha_1"), TAMPERED, IRREPRODUCIBLE, "the fit",
        "evidence.json: calibration.alpha_1: does not follow from the readings"),
    "beta": Tampering(fit("beta_kg"), TAMPERED, IRREPRODUCIBLE, "the fit",
        "evidence.json: calibration.beta_kg: does not follow from the readings"),
    "slope": Tampering(fit("c1_1"), TAMPERED, IRREPRODUCIBLE, "the fit",
        "evidence.json: calibration.c1_1: does not follow from the readings"),
    "a digit of the covariance": Tampering(
        fit("covariance", 1), TAMPERED, IRREPRODUCIBLE, "the fit",
        "evidence.json: calibration.covariance.1: does not follow from the readings"),
    "chi squared": Tampering(fit("chi2_1"), TAMPERED, IRREPRODUCIBLE, "the fit",
        "evidence.json: calibration.chi2_1: does not follow from the readings"),
    "the uncertainty": Tampering(fit("u_kg"), TAMPERED, IRREPRODUCIBLE, "the fit",
        "evidence.json: calibration.u_kg: does not follow from the readings"),
    "the coverage factor": Tampering(fit("coverage_k_1"), TAMPERED, IRREPRODUCIBLE, "the fit",
        "evidence.json: calibration.coverage_k_1: does not follow from the readings"),
    "the valid range": Tampering(fit("range_kg", 1), TAMPERED, IRREPRODUCIBLE, "the fit",
        "evidence.json: calibration.range_kg.1: does not follow from the readings"),
    "a row of the budget": Tampering(fit("budget", 0, "u_kg"), TAMPERED, IRREPRODUCIBLE, "the fit",
        "evidence.json: calibration.budget.0.u_kg: does not follow from the readings"),
    "an error of a point": Tampering(
        fit("points", 2, "error_kg"), TAMPERED, IRREPRODUCIBLE, "the fit",
        "evidence.json: calibration.points.2.error_kg: does not follow from the readings"),
    "a sentence": Tampering(
        in_evidence("calibration", "says", to=[]), TAMPERED, IRREPRODUCIBLE, "the fit",
        "evidence.json: calibration.says: does not follow from the readings"),
    "the confidence": Tampering(
        in_evidence("options", "confidence_1", to=0.5), TAMPERED, IRREPRODUCIBLE, "the fit",
        "evidence.json: options: do not match the campaign's method"),
    "the verdict's risk": Tampering(
        in_evidence("limits", "risk_1", to=0.5), TAMPERED, IRREPRODUCIBLE, "the fit",
        "evidence.json: limits.risk_1: does not follow from the readings"),
    "the asked class": Tampering(
        in_evidence("campaign", "decision", "accuracy_class", to="OIML R 134 0.2"),
        TAMPERED, IRREPRODUCIBLE, "the fit",
        "evidence.json: limits.risk_1: does not follow from the readings"),
    "the verdict": Tampering(
        in_evidence("limits", "verdict", to="outside"), TAMPERED, IRREPRODUCIBLE, "the fit",
        "evidence.json: limits.verdict: does not follow from the readings"),
    "the last day": Tampering(
        in_evidence("expires", to="2035-01-01"), TAMPERED, IRREPRODUCIBLE, "the campaign",
        "evidence.json: expires: is not 2027-05-04, which follows from the days of the runs"),
    "the intended use": Tampering(
        in_evidence("campaign", "campaign", "intended_use", to="trade"),
        TAMPERED, None, "the campaign", "statement.dsse.json: is not signed by the key"),
    "the author": Tampering(
        in_evidence("campaign", "campaign", "author", to="N. N."),
        TAMPERED, None, "the campaign", "statement.dsse.json: is not signed by the key"),
    "the notice": Tampering(
        in_evidence("notice", to="Legal for trade."),
        TAMPERED, TAMPERED, "the campaign", "the schema of evidence at notice: Input should be"),
    "an unknown key": Tampering(
        lambda b: b.evidence.update(more=1), TAMPERED, TAMPERED, "the campaign",
        "the schema of evidence at more: Extra inputs are not permitted"),
    "a number as text": Tampering(
        in_evidence("chain", "counter", to="2"), TAMPERED, TAMPERED, "the campaign",
        "evidence.json: a value has another type"),
    "the machine's id": Tampering(
        in_evidence("campaign", "machine", "id", to="sledge-8"),
        TAMPERED, IRREPRODUCIBLE, "the campaign",
        "the machine file belongs to machine 'sledge-7', but the campaign to 'sledge-8'"),
    "a part": Tampering(
        in_evidence("campaign", "machine", "parts", "runners", to="R-2"),
        TAMPERED, None, "the campaign", "statement.dsse.json: is not signed by the key"),
    "the machine's mass": Tampering(
        in_evidence("machine", "machine", "empty_mass_kg", to=101.0),
        TAMPERED, IRREPRODUCIBLE, "the campaign",
        "evidence.json: estimator: does not match the settings"),
    "a setting": Tampering(
        in_evidence("machine", "settings", "gate", "window_samples", to=300),
        TAMPERED, IRREPRODUCIBLE, "the campaign",
        "evidence.json: estimator: does not match the settings"),
    "a channel's scale": Tampering(
        in_evidence("machine", "channels", "force_x_N", "scale", to=1.1),
        TAMPERED, IRREPRODUCIBLE, "the campaign",
        "evidence.json: estimator: does not match the settings"),
    "a reference mass": Tampering(
        in_evidence("campaign", "masses", 0, "value_kg", to=21.0),
        TAMPERED, IRREPRODUCIBLE, "the campaign",
        "evidence.json: references: are not the sums of the masses on board"),
    "a mass' uncertainty": Tampering(
        in_evidence("campaign", "masses", 0, "u_kg", to=0.011),
        TAMPERED, IRREPRODUCIBLE, "the campaign",
        "evidence.json: references: are not the sums of the masses on board"),
    "what masses share": Tampering(
        in_evidence("campaign", "masses", 1, "shared_u_kg", to=0.0),
        TAMPERED, IRREPRODUCIBLE, "the campaign",
        "evidence.json: references: are not the sums of the masses on board"),
    "a certificate": Tampering(
        in_evidence("campaign", "masses", 0, "certificate", to="K-9"),
        TAMPERED, None, "the campaign", "statement.dsse.json: is not signed by the key"),
    "an expired certificate": Tampering(
        in_evidence("campaign", "masses", 0, "expires", to="2026-01-01"),
        TAMPERED, INCOMPLETE, "the campaign",
        "run 'run-1' of 2026-05-02: the certificate of mass 'block-1' expired on 2026-01-01"),
    "the references": Tampering(
        in_evidence("references", 1, "reference_kg", to=121.0),
        TAMPERED, IRREPRODUCIBLE, "the campaign",
        "evidence.json: references: are not the sums of the masses on board"),
    "the day of a run": Tampering(
        in_evidence("campaign", "runs", 0, "day", to="2026-05-03"),
        TAMPERED, IRREPRODUCIBLE, "the campaign",
        "run 'run-0', reading 1: belongs to another load, day or log than its run"),
    "a load on board": Tampering(
        in_evidence("campaign", "runs", 1, "loads", to=["block-2"]),
        TAMPERED, IRREPRODUCIBLE, "the campaign",
        "evidence.json: references: are not the sums of the masses on board"),
    "a run excluded afterwards": Tampering(
        in_evidence("campaign", "runs", 2, "excluded", to="wheel slip"),
        TAMPERED, IRREPRODUCIBLE, "the campaign",
        "readings.parquet: run 'run-2', reading 1: is used, although its run is excluded"),
    "the operator": Tampering(
        in_evidence("campaign", "runs", 0, "operator", to="N. N."),
        TAMPERED, None, "the campaign", "statement.dsse.json: is not signed by the key"),
    "a dropped run": Tampering(without_run, TAMPERED, INCOMPLETE, "tables",
        "readings.parquet: run 'run-1': is missing"),
    "a run dropped everywhere": Tampering(without_run_anywhere, TAMPERED, IRREPRODUCIBLE, "tables",
        "evidence.json: learnt: belongs to other logs than the campaign's"),
    "swapped logs": Tampering(swapped_logs, TAMPERED, None, "logs",
        "statement.dsse.json: is not signed by the key"),
    "a log's digest": Tampering(
        in_evidence("logs", 0, "files", 0, "sha256", to="0" * 64),
        TAMPERED, None, "logs", "statement.dsse.json: is not signed by the key"),
    "the mean of a prior that was learnt": Tampering(
        in_evidence("learnt", "terms", "const", "mean", to=lambda x: x + 1.0),
        TAMPERED, IRREPRODUCIBLE, "learnt priors",
        "evidence.json: learnt: does not follow from its logs"),
    "the width of one": Tampering(
        in_evidence("learnt", "terms", "const", "std", to=lambda x: x * 0.5),
        TAMPERED, IRREPRODUCIBLE, "learnt priors",
        "evidence.json: learnt: does not follow from its logs"),
    "one that was not learnt": Tampering(
        lambda b: b.evidence["learnt"]["terms"].update(
            const_yaw={"mean": 0.0, "std": 1.0, "mean_u": 1.0}),
        TAMPERED, TAMPERED, "learnt priors",
        "the schema of evidence at learnt.terms.const_yaw.[key]: Input should be"),
    "what a log said of a nuisance": Tampering(
        in_evidence("learnt", "logs", 0, "posterior", to=lambda x: x + 0.01),
        TAMPERED, IRREPRODUCIBLE, "learnt priors",
        "evidence.json: learnt: does not follow from its logs"),
    "what a log said left out": Tampering(
        lambda b: b.evidence["learnt"]["logs"].pop(0), TAMPERED, IRREPRODUCIBLE, "learnt priors",
        "evidence.json: learnt: does not follow from its logs"),
    "what a log said, twice": Tampering(
        in_evidence("learnt", "logs", to=lambda x: [*x, x[0]]),
        TAMPERED, IRREPRODUCIBLE, "learnt priors",
        "evidence.json: learnt: lists a term of one log twice"),
    "what another log said": Tampering(
        in_evidence("learnt", "logs", 0, "log", to="load-9.csv"),
        TAMPERED, IRREPRODUCIBLE, "learnt priors",
        "evidence.json: learnt: belongs to other logs than the campaign's"),
    "nothing learnt": Tampering(
        in_evidence("learnt", to=None), TAMPERED, IRREPRODUCIBLE, "learnt priors",
        "evidence.json: estimator: does not match the settings"),
    "priors made narrow throughout": Tampering(relearnt, TAMPERED, None, "learnt priors",
        "statement.dsse.json: is not signed by the key"),
    "a log that could not weigh": Tampering(
        in_evidence("logs", 0, "can_weigh", to=False), TAMPERED, IRREPRODUCIBLE, "logs",
        "readings.parquet: run 'run-0', reading 1: is used, although its log cannot weigh"),
    "the mass of a reading": Tampering(another_mass, TAMPERED, IRREPRODUCIBLE, "tables",
        "evidence.json: calibration.alpha_1: does not follow from the readings"),
    "a dropped reading": Tampering(without_reading, TAMPERED, IRREPRODUCIBLE, "tables",
        "readings.parquet: run 'run-0', reading 2: should be reading 1 of its run"),
    "a reading more": Tampering(one_reading_more, TAMPERED, IRREPRODUCIBLE, "tables",
        "evidence.json: calibration.alpha_1: does not follow from the readings"),
    "a reading rejected without a reason": Tampering(
        reading(0, used=False), TAMPERED, INCOMPLETE, "tables",
        "readings.parquet: run 'run-0', reading 1: is left out without a reason"),
    "a reading rejected with one": Tampering(
        reading(0, used=False, reason="outlier"), TAMPERED, IRREPRODUCIBLE, "tables",
        "evidence.json: calibration.alpha_1: does not follow from the readings"),
    "a reading of another log": Tampering(
        reading(0, log="load-9.csv"), TAMPERED, IRREPRODUCIBLE, "tables",
        "run 'run-0', reading 1: belongs to another load, day or log than its run"),
    "the points": Tampering(moved_point, TAMPERED, IRREPRODUCIBLE, "tables",
        "points.parquet: does not follow from the readings"),
    "the line before": Tampering(
        in_evidence("as_found", "alpha_1", to=lambda x: x * 1.01),
        TAMPERED, IRREPRODUCIBLE, "chain",
        "evidence.json: as_found.rms_error_kg: does not follow from the points"),
    "the counter": Tampering(in_evidence("chain", "counter", to=7), TAMPERED, TAMPERED, "chain",
        "evidence.json: chain.counter: is not one more than the counter of the previous evidence"),
    "the link": Tampering(
        in_evidence("chain", "previous", "sums_sha256", to="0" * 64), TAMPERED, None, "chain",
        "evidence.json: chain.previous: is not the previous evidence that was given"),
    "no link": Tampering(
        lambda b: b.evidence.update(chain={"counter": 1, "previous": None}),
        TAMPERED, None, "chain", "evidence.json: chain.counter: is 1, but that of the previous"),
    "a tolerance that forgives": Tampering(
        in_evidence("replay_tolerance_kg", to=1e9),
        TAMPERED, TAMPERED, "the campaign",
        "the schema of evidence at replay_tolerance_kg: Input should be"),
    "the software": Tampering(
        in_evidence("software", "python", to="4.0.0"),
        TAMPERED, None, "the campaign", "statement.dsse.json: is not signed by the key"),
    "an edited report": Tampering(of_bytes(REPORT, edited_report), TAMPERED, TAMPERED, "files",
        "report.html: differs from the page made from the evidence"),
    "a removed report": Tampering(
        at_last(lambda f: (f / REPORT).unlink()),
        INCOMPLETE, INCOMPLETE, "files", "report.html: is missing"),
    "removed points": Tampering(
        at_last(lambda f: (f / POINTS).unlink()),
        INCOMPLETE, INCOMPLETE, "files", "points.parquet: is missing"),
    "removed digests": Tampering(
        at_last(lambda f: (f / SUMS).unlink()),
        INCOMPLETE, INCOMPLETE, "files", "SHA256SUMS: is missing"),
    "one digest removed": Tampering(at_last(dropped_sum), TAMPERED, TAMPERED, "files",
        "calibration.rrd: is not listed in SHA256SUMS"),
    "a renamed file": Tampering(
        at_last(lambda f: (f / REPORT).rename(f / "report.htm")),
        TAMPERED, TAMPERED, "files", "report.htm: does not belong to a bundle"),
    "an added file": Tampering(
        at_last(lambda f: (f / "note.txt").write_text("n")),
        TAMPERED, TAMPERED, "files", "note.txt: does not belong to a bundle"),
    "an added folder": Tampering(
        at_last(lambda f: (f / "more").mkdir()),
        TAMPERED, TAMPERED, "files",
        "more/: is a folder, which a bundle cannot contain; it was not opened"),
    "an added folder of recordings": Tampering(
        at_last(lambda f: (f / "runs").mkdir()),
        TAMPERED, TAMPERED, "files", "runs/: is an empty folder, which a bundle cannot contain"),
    "an added recording": Tampering(
        lambda b: ((b.folder / "runs").mkdir(), (b.folder / "runs/x.rrd").write_bytes(b"RRF2")),
        TAMPERED, TAMPERED, "files", "runs/x.rrd: is a recording that the evidence does not name"),
    "a link": Tampering(at_last(link), TAMPERED, TAMPERED, "files",
        "report.html: is a link, which a bundle cannot contain; it was not followed"),
    "a line end": Tampering(
        of_bytes(EVIDENCE, lambda data: data + b"\n"),
        TAMPERED, TAMPERED, "JSON", "evidence.json: is not in the canonical form of RFC 8785"),
    "spaces": Tampering(
        of_bytes(EVIDENCE, lambda data: data.replace(b'{"', b'{ "', 1)),
        TAMPERED, TAMPERED, "JSON", "evidence.json: is not in the canonical form of RFC 8785"),
    "a compressed table": Tampering(
        of_bytes(READINGS, lambda data: compressed(data)), TAMPERED, TAMPERED, "tables",
        "readings.parquet: is not the table whose digest evidence.json has"),
    "another recording": Tampering(
        of_bytes(RECORDING, lambda data: data + b"\0"),
        TAMPERED, None, "files", "statement.dsse.json: is not signed by the key"),
}  # fmt: skip
