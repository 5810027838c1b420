"""The page that checks evidence in a browser: its arithmetic against ours, what it finds."""

import re
import shutil
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from analysis.calibration.line.calibration import CalibrationOptions, StatedPart
from analysis.calibration.line.line_fit import fit_calibration_line
from recordings.calibration.bundle_folder import REPORT, STATEMENT
from recordings.calibration.page.verifier_page import (
    build_verifier_page,
    compute_verifier_page_sha256,
)
from recordings.signatures.signing import PublicKey
from replay.calibration.calibrate_campaign import calibrate_from_campaign
from tests.conftest import REPO
from tests.replay.attacker import Tamper, key_files, sign_with_own_key, tampered
from tests.replay.calibration.test_calibrate_campaign import ONE_LOAD
from tests.replay.made_evidence import Made
from tests.replay.released_evidence import FORMAT_2, FORMAT_3, unpacked
from tests.replay.sledge import Payscope, join_to_one_line
from tests.replay.tamperings import TAMPERINGS, in_evidence
from tests.twins import mark_heavy_after

pytestmark = pytest.mark.usefixtures("kept_replays")

#: α, β, c0, … of two programs that iterate to their own last digit.
TOLERANCE = 1e-6
RESULTS = ("α", "β", "valid for", "expanded uncertainty")


@dataclass
class ShownBundle:
    """What the page shows of a bundle."""

    verdict: str
    signed: str
    findings: str
    rows: dict[str, list[str]]


class Verifier:
    """The page, open in a browser without a network."""

    def __init__(self, chromium: Any, file: Path) -> None:
        self.context = chromium.new_context(offline=True)
        self.page: Any = self.context.new_page()
        self.asked: list[str] = []
        self.complaints: list[str] = []
        page: Any = self.page

        def ask(request: Any) -> None:
            self.asked.append(request.url)

        def complain(what: Any) -> None:
            self.complaints.append(str(getattr(what, "text", what)))

        page.on("request", ask)
        page.on("console", complain)
        page.on("pageerror", complain)
        self.page.goto(file.as_uri())

    def check(
        self, bundle: Path, key: Path | None = None, *, field: str = "#folder"
    ) -> ShownBundle:
        page = self.page
        page.evaluate("held = null; document.getElementById('result').replaceChildren()")
        page.fill("#key", "" if key is None else key.read_text())
        page.set_input_files(field, str(bundle))
        page.wait_for_selector("#verdict")
        texts = page.evaluate(
            """() => ["verdict", "signed", "findings"].map(
               (id) => document.getElementById(id)?.innerText ?? "")"""
        )
        rows = page.evaluate(
            """() => [...document.querySelectorAll("#result tbody tr")].map(
               (row) => [...row.cells].map((cell) => cell.textContent))"""
        )
        verdict, signed, findings = texts
        return ShownBundle(verdict, signed, findings, {name: cells for name, *cells in rows})


@pytest.fixture(scope="module")
def page_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("verifier") / "page.html"
    path.write_bytes(build_verifier_page())
    return path


@pytest.fixture(scope="module")
def verifier(chromium: Any, page_file: Path) -> Iterator[Verifier]:
    found = Verifier(chromium, page_file)
    yield found
    found.context.close()


def holds(shown: ShownBundle) -> bool:
    """Whether the three columns of every number are the same."""
    facts = [cells for cells in shown.rows.values() if len(cells) == 4]
    return bool(facts) and all(cells[3] == "same" and len(set(cells[:3])) == 1 for cells in facts)


def test_the_page_is_small_the_same_twice_and_the_one_that_the_version_names(
    payscope: Payscope, tmp_path: Path
) -> None:
    page = build_verifier_page()
    assert page == build_verifier_page()
    assert len(page) <= 100_000
    assert compute_verifier_page_sha256() in payscope("--version").out
    out = tmp_path / "page.html"
    assert compute_verifier_page_sha256() in payscope("verify", "--page", "-o", out).out
    assert out.read_bytes() == page
    join_to_one_line(payscope("verify", "--page", "-o", out), "exists already")
    join_to_one_line(payscope("verify", tmp_path, "--page"), "the same page for all evidence")
    join_to_one_line(payscope("verify"), "give the folder of the evidence")
    for name in ("http://", "https://", "{version}", "{script"):
        # names of formats are no addresses that anything is fetched from
        text = page.decode().replace("https://in-toto.io/Statement/v1", "")
        assert name not in text.replace("https://payscope.invalid/calibration-evidence/v1", "")


def test_the_changelog_has_the_digest_of_no_other_page() -> None:
    text = (REPO / "CHANGELOG.md").read_text(encoding="utf-8")
    about = r"SHA-256 of the page of this version.{0,80}?`([0-9a-f]{64})`"
    stated = re.findall(about, text, re.DOTALL)
    assert set(stated[:1]) <= {compute_verifier_page_sha256()}


def test_a_bundle_gives_the_numbers_that_evidence_and_report_have(
    verifier: Verifier, made: Made
) -> None:
    shown = verifier.check(made.bundle, made.public)
    assert shown.verdict.startswith("Holds:"), shown
    assert shown.signed == "Signed by the key that you gave, that calls itself “T. Signer”."
    assert holds(shown)
    report = (made.bundle / REPORT).read_text(encoding="utf-8")
    for name in RESULTS:
        assert f"<dt>{name}</dt><dd>{shown.rows[name][0]}</dd>" in report
    assert verifier.asked[0].startswith("file:")
    assert len(verifier.asked) == 1
    assert not verifier.complaints


@pytest.mark.parametrize("archive", [FORMAT_2, FORMAT_3], ids=lambda path: path.name)
def test_bundles_of_released_versions_hold(
    verifier: Verifier, archive: Path, tmp_path: Path
) -> None:
    folder = unpacked(archive, tmp_path)
    (bundle,) = folder.rglob("second")
    (key,) = folder.rglob("*.pub.pem")
    shown = verifier.check(bundle, key)
    assert shown.verdict.startswith("Holds:"), shown
    assert holds(shown)


def test_a_real_axis_with_one_load_has_no_line_and_the_same_difference(
    verifier: Verifier, shared_data: Path, tmp_path: Path
) -> None:
    shutil.copy(REPO / "examples/linear_axis.toml", tmp_path / "axis.toml")
    shutil.copy(shared_data / "logs/linear_axis.csv", tmp_path)
    (tmp_path / "campaign.toml").write_text(ONE_LOAD)
    made = calibrate_from_campaign(tmp_path / "campaign.toml", tmp_path / "evidence")
    shown = verifier.check(made.folder)
    own, state = shown.rows["load empty"]
    assert state == "same"
    assert own in (made.folder / REPORT).read_text(encoding="utf-8")
    assert shown.verdict.startswith("Expired: what this page checks holds")


@pytest.mark.slow
def test_the_demos_campaign_gives_the_same_alpha_beta_and_u(
    verifier: Verifier, payscope: Payscope, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("campaign", "calibration"):
        shutil.copy(REPO / f"examples/{name}.toml", tmp_path)
    shutil.copy(REPO / "replay/machines/cat262c.toml", tmp_path)
    private, public = key_files(tmp_path)
    assert payscope("simulate", "campaign.toml", "-o", "campaign.bag").status == 0
    assert payscope("calibrate", "calibration.toml", "-o", "made", "--key", private).status == 0
    shown = verifier.check(tmp_path / "made", public)
    assert shown.verdict.startswith("Expired: what this page checks holds")
    assert holds(shown)


def test_without_the_key_nothing_is_trusted(verifier: Verifier, made: Made) -> None:
    shown = verifier.check(made.bundle)
    assert shown.verdict == "Contradicts itself nowhere, and nobody whom you know vouches for it"
    assert "unknown key that calls itself “T. Signer”: not trusted" in shown.signed


def test_a_zip_is_read_as_well(verifier: Verifier, made: Made, tmp_path: Path) -> None:
    packed = tmp_path / "evidence.zip"
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for path in made.bundle.iterdir():
            archive.write(path, f"second/{path.name}")
    shown = verifier.check(packed, made.public, field="#files")
    assert shown.verdict.startswith("Holds:"), shown


def test_alpha_changed_in_evidence_and_page_alike_is_found(
    verifier: Verifier, made: Made, tmp_path: Path
) -> None:
    """The page is made of the forged evidence, every digest anew, and signed by the forger."""

    def forge(bundle: Any) -> None:
        bundle.evidence["calibration"]["alpha_1"] = 0.9
        sign_with_own_key(bundle)

    folder = tampered(made.bundle, tmp_path / "b", forge, signed=True)
    shown = verifier.check(folder)
    assert "0.9000 (" in (folder / REPORT).read_text(encoding="utf-8")
    assert shown.verdict.startswith("Tampered")
    assert "evidence.json: calibration.alpha_1: does not follow from the readings" in shown.findings
    assert "report.html: α: prints “0.9000" in shown.findings
    with_key = verifier.check(folder, made.public)
    assert "not by the key that you gave" in with_key.findings
    assert "Signed by" not in with_key.signed


@pytest.mark.parametrize(
    "name",
    mark_heavy_after(
        1,
        [
            "alpha",
            "the uncertainty",
            "a row of the budget",
            "a reference mass",
            "what masses share",
            "the mass of a reading",
            "a dropped reading",
            "a run excluded afterwards",
            "the points",
            "an edited report",
            "a removed report",
            "one digest removed",
            "an added file",
            "spaces",
            "a compressed table",
            "another recording",
            "the counter",
            "the intended use",
        ],
    ),
)
def test_a_tampering_is_found_with_the_key(
    verifier: Verifier, made: Made, tmp_path: Path, name: str
) -> None:
    tamper: Tamper = TAMPERINGS[name].tamper
    shown = verifier.check(tampered(made.bundle, tmp_path / "b", tamper, signed=True), made.public)
    assert shown.findings
    assert "Signed by" not in shown.signed, shown


def test_without_a_signature_numbers_that_contradict_the_readings_are_found(
    verifier: Verifier, made: Made, tmp_path: Path
) -> None:
    for name in ("beta", "the valid range", "the mass of a reading", "a mass' uncertainty"):
        folder = tampered(made.bundle, tmp_path / name, TAMPERINGS[name].tamper, signed=False)
        shown = verifier.check(folder)
        assert "UNSIGNED" in shown.signed
        assert "does not follow from the readings" in shown.findings, (name, shown)


def test_another_key_a_weak_key_and_a_private_key_are_refused(
    verifier: Verifier, made: Made, tmp_path: Path
) -> None:
    _, other = key_files(tmp_path, "other")
    shown = verifier.check(made.bundle, other)
    assert "not by the key that you gave" in shown.findings
    assert shown.signed == "Signature not valid."
    for weak, why in (
        ((1).to_bytes(32, "little"), "of small order"),
        (bytes(32), "of small order"),
        ((2**255 - 19).to_bytes(32, "little"), "canonical form"),
        ((2).to_bytes(32, "little"), "not a point of the curve"),
        (
            Ed25519PrivateKey.from_private_bytes(bytes(32)).public_key().public_bytes_raw(),
            "published",
        ),
    ):
        pasted = tmp_path / "weak"
        pasted.write_text(PublicKey(weak).base64_text)
        assert why in verifier.check(made.bundle, pasted).verdict
    assert "private key" in verifier.check(made.bundle, made.private).verdict


def test_a_folder_without_evidence_or_with_two_is_refused(
    verifier: Verifier, made: Made, tmp_path: Path
) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "empty" / "note.txt").write_text("n")
    assert "no evidence in it" in verifier.check(tmp_path / "empty").verdict
    shutil.copytree(made.bundle, tmp_path / "two/a")
    shutil.copytree(made.first, tmp_path / "two/b")
    assert "one at a time" in verifier.check(tmp_path / "two").verdict


def test_texts_of_a_bundle_are_never_run(verifier: Verifier, made: Made, tmp_path: Path) -> None:
    nasty = "<img src=x onerror='document.title=1'><script>document.title=1</script>"
    tamper = in_evidence("signer", "name", to=nasty)
    shown = verifier.check(tampered(made.bundle, tmp_path / "b", tamper, signed=True))
    assert shown.verdict
    assert verifier.page.title() == "Check calibration evidence"


#: RFC 8032, 7.1: public key, message, signature.
RFC_8032 = (
    (
        "d75a980182b10ab7d54bfed3c964073a0ee172f3daa62325af021a68f707511a",
        "",
        "e5564300c360ac729086e2cc806e828a84877f1eb8e5d974d873e06522490155"
        "5fb8821590a33bacc61e39701cf9b46bd25bf5f0595bbe24655141438e7a100b",
    ),
    (
        "3d4017c3e843895a92b70aa74d1b7ebc9c982ccf2ec4968cc0cd55f12af4660c",
        "72",
        "92a009a9f0d4cab8720e820b5f642540a2b27b5416503f8fb3762223ebdb69da"
        "085ac1e43e15996e458f3613d0f11d8c387b2eaeb4302aeeb00d291612bb0c00",
    ),
    (
        "fc51cd8e6218a1a38da47ed00230f0580816ed13ba3303ac5deb911548908025",
        "af82",
        "6291d657deec24024827e69c3abe01a30ce548a284743a445e3680d7db5ac3ac"
        "18ff9b538d16f290ae67f760984dc6594a7c15e9716ed28dc027beceea1ec40a",
    ),
)
_VERIFY = "(each) => ownVerify(...each.map(unhex))"
_L = 2**252 + 27742317777372353535851937790883648493


def test_its_own_ed25519_has_the_vectors_of_rfc_8032(verifier: Verifier) -> None:
    for key, message, signature in RFC_8032:
        assert verifier.page.evaluate(_VERIFY, [key, signature, message])
        s = int.from_bytes(bytes.fromhex(signature)[32:], "little") + _L
        twin = signature[:64] + s.to_bytes(32, "little").hex()
        assert not verifier.page.evaluate(_VERIFY, [key, twin, message])
        assert not verifier.page.evaluate(_VERIFY, [key, signature, message + "00"])


def test_its_own_hashes_and_signatures_are_those_of_the_browser(verifier: Verifier) -> None:
    """Messages of every length about a block's, keys anew each time; a flipped bit is refused."""
    rng = np.random.default_rng(31)
    for length in (0, 1, 55, 56, 63, 64, 111, 112, 127, 128, 129, 1000):
        key, message = Ed25519PrivateKey.generate(), rng.bytes(length)
        signature = bytearray(key.sign(message))
        for flip in (None, int(rng.integers(512))):
            if flip is not None:
                signature[flip // 8] ^= 1 << flip % 8
            words = [key.public_key().public_bytes_raw().hex(), signature.hex(), message.hex()]
            own, browser, hashes = verifier.page.evaluate(
                """async (each) => {
                  const [key, signature, message] = each.map(unhex);
                  const theirs = async (name) =>
                    new Uint8Array(await crypto.subtle.digest(name, message));
                  const browser = await browserVerify(key, signature, message);
                  return [ownVerify(key, signature, message), browser,
                    sameBytes(ownSha256(message), await theirs("SHA-256")) &&
                    sameBytes(sha512(message), await theirs("SHA-512"))];
                }""",
                words,
            )
            assert own is (flip is None)
            assert browser in (own, None)
            assert hashes


def campaign(seed: int) -> tuple[dict[str, Any], pl.DataFrame, Any]:
    """A campaign by chance, as evidence has it; its readings; and our calibration of it."""
    rng = np.random.default_rng(seed)
    count, days = int(rng.integers(3, 7)), int(rng.integers(1, 5))
    masses: list[dict[str, Any]] = [
        {"id": f"m{k}", "value_kg": 50.0, "u_kg": float(rng.uniform(0.1, 4.0)),
         "source": "s" if rng.random() < 0.5 else "", "shared_u_kg": 0.05}
        for k in range(1, count)
    ]  # fmt: skip
    rows: list[dict[str, Any]] = []
    runs: list[dict[str, Any]] = []
    day_kg = rng.normal(0.0, 8.0, days)
    bend = 40.0 if seed % 4 == 0 else 0.0
    for number in range(count * int(rng.integers(1, 4))):
        on_board = [f"m{k}" for k in range(1, number % count + 1)]
        day = int(rng.integers(days))
        load = "+".join(on_board) or "empty"
        run = {"id": f"r{number}", "loads": on_board, "day": f"2026-05-0{day + 1}", "log": "a"}
        runs.append(run)
        level = 1000.0 + 48.0 * len(on_board) + bend * (len(on_board) % 2) + day_kg[day]
        for reading in range(1, int(rng.integers(1, 9)) + 1):
            used = bool(rng.random() < 0.9) or reading == 1
            rows.append(
                {"run_id": run["id"], "load_id": load, "day": run["day"], "log": "a",
                 "reading": reading, "mass_kg": level + float(rng.normal(0.0, 5.0)),
                 "common_u_kg": 3.0, "used": used, "reason": "" if used else "slip"}
            )  # fmt: skip
    loads = list(dict.fromkeys("+".join(run["loads"]) or "empty" for run in runs))
    stated = (StatedPart("tare", 1.5, absorbed=False, known="so"),) if seed % 3 == 0 else ()
    options = CalibrationOptions("joint_mass", 0.95, 6.0 if seed % 5 == 0 else None, 0.1, stated)
    on_board_1 = np.array([[float(m["id"] in load.split("+")) for m in masses] for load in loads])
    shared = np.array(
        [[a["u_kg"] ** 2 if a is b else 0.05**2 * bool(a["source"] and b["source"])
          for a in masses] for b in masses]
    )  # fmt: skip
    covariance = on_board_1 @ shared @ on_board_1.T + 0.25
    references = pl.DataFrame(
        {"load_id": loads, "reference_kg": 1000.0 + 50.0 * on_board_1.sum(axis=1)}
    )
    frame = pl.DataFrame(rows)
    ours = fit_calibration_line(frame, references, covariance, options)
    evidence = {
        "campaign": {"masses": masses, "runs": runs, "method": {"estimator": "joint_mass"}},
        "machine": {"machine": {"empty_mass_kg": 1000.0, "empty_mass_u_kg": 0.5}},
        "references": [{"load_id": load} for load in loads],
        "options": {
            "confidence_1": 0.95,
            "day_known_kg": options.day_known_kg,
            "margin_1": 0.1,
            "stated": [
                {"component": s.component, "u_kg": s.u_kg, "absorbed": s.absorbed} for s in stated
            ],
        },
    }
    return evidence, frame, ours


@pytest.mark.heavy
def test_its_fit_is_ours_for_campaigns_of_every_kind(verifier: Verifier) -> None:
    """Several days, loads off the line, a known day, shared masses, few and many readings."""
    seen = set[str]()
    for seed in range(24):
        evidence, readings, ours = campaign(seed)
        stored = ours.to_dict()
        found = verifier.page.evaluate(
            """([evidence, readings, stored]) =>
               [calibrationOf(evidence, readings)].map((each) =>
                 [differences(stored, each, "calibration"), each.alpha_1])[0]""",
            [evidence, readings.to_dicts(), stored],
        )
        assert found[0] == [], (seed, found)
        assert found[1] == pytest.approx(ours.alpha_1, rel=TOLERANCE)
        seen |= {component.name for component in ours.components}
    assert seen == {"repeatability", "run to run", "day to day", "lack of fit", "references"}


def test_student_and_fisher_are_those_of_scipy(verifier: Verifier) -> None:
    from scipy.special import fdtrc, stdtrit

    for freedom in (1.0, 1.7, 4.0, 9.3, 52.0, 1e4):
        for confidence in (0.5, 0.95, 0.999):
            own = verifier.page.evaluate(f"studentFactor({confidence}, {freedom})")
            assert own == pytest.approx(float(stdtrit(freedom, 0.5 + confidence / 2)), rel=1e-9)
    assert verifier.page.evaluate("studentFactor(0.95, Infinity)") == pytest.approx(1.959963984540)
    for above, below, ratio in ((1, 4, 0.3), (4, 12, 2.5), (3, 60, 20.0)):
        own = verifier.page.evaluate(f"beyondF({above}, {below}, {ratio})")
        assert own == pytest.approx(float(fdtrc(above, below, ratio)), rel=1e-9)


def test_numbers_are_printed_as_the_report_prints_them(verifier: Verifier) -> None:
    for value in (0.125, 0.375, 2.5, -2.5, 1234567.25, -0.04, 0.05, 999.95, 1e-9, -1234.5):
        for digits in (0, 1, 2, 4):
            own = verifier.page.evaluate(f"grouped({value!r}, {digits})")
            assert own == f"{value:,.{digits}f}"


@pytest.mark.heavy
@pytest.mark.parametrize("opened", [(380, "light"), (380, "dark"), (1280, "dark")], indirect=True)
def test_it_is_accessible_and_fits_a_phone(opened: Any, made: Made) -> None:
    from axe_playwright_python.sync_playwright import Axe

    opened.set_input_files("#folder", str(made.bundle))
    opened.wait_for_selector("#verdict")
    found = Axe().run(opened).response["violations"]
    assert [each["id"] for each in found if each["impact"] in ("serious", "critical")] == []
    width = opened.viewport_size["width"]
    assert opened.evaluate("document.documentElement.scrollWidth") <= width
    assert not opened.complaints


@pytest.mark.heavy
def test_a_statement_that_was_made_for_another_bundle_is_found(
    verifier: Verifier, made: Made, tmp_path: Path
) -> None:
    folder = Path(shutil.copytree(made.bundle, tmp_path / "b"))
    shutil.copy(made.first / STATEMENT, folder / STATEMENT)
    shown = verifier.check(folder, made.public)
    assert "is about other evidence" in shown.findings
    assert "Signature not valid" in shown.signed
