"""Every attack on evidence in one list: what is done, how `payscope` is asked, exit and words.

The attacker writes every file and computes every digest anew. He lacks the signer's key where the
list does not say otherwise.
"""

import pickle
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from recordings.calibration.bundle_folder import EVIDENCE, REPORT, STATEMENT
from tests.replay.attack_steps import (
    Asked,
    at,
    began,
    chain,
    chained_to_forged,
    chained_to_unknown,
    changed,
    copied,
    forged_before,
    forged_between,
    forked,
    in_envelope,
    in_statement,
    later_version,
    linked,
    logged_machine,
    make_anew,
    of_first,
    on_a_fork,
    piped,
    required_unknown,
    resigned,
    signature,
    signed_as_other_kind,
    signed_under_other_type,
    signed_under_the_signers_id,
    sister_spliced,
    skipped,
    swollen,
    twin_signature,
    unsigned,
    used_anew,
    used_forged,
    used_of_other_machine,
    used_unknown,
    used_unsigned,
    used_with_other_settings,
    verified,
    weak_key_forgery,
    with_bytes,
    with_line,
    with_other_key,
)
from tests.replay.made_evidence import Made
from tests.replay.tamperings import TAMPERINGS, fit, in_evidence, of_bytes, reading, relearnt


@dataclass(frozen=True)
class Attack:
    """One attack.

    Attributes:
        kind: of the list's parts.
        name: what is done.
        asked: does it in a folder, and gives the words that `payscope` is called with.
        exit: status of the command.
        words: that it prints.
    """

    kind: str
    name: str
    asked: Callable[[Made, Path], Asked]
    exit: int
    words: str


#: Bytes in the place of evidence.json, and why they are refused.
JSON_FORMS: tuple[tuple[str, bytes, str], ...] = (
    ("lists too deep", b"[" * 100_000, "nested deeper"),
    ("objects too deep", b'{"a":' * 40 + b"1" + b"}" * 40, "nested deeper"),
    ("a number of 5000 digits", b'{"a":' + b"9" * 5000 + b"}", "a number has 5000 digits"),
    ("an exponent too long", b'{"a":1e' + b"9" * 5000 + b"}", "a number has 5002 characters"),
    ("infinity by exponent", b'{"a":1e999}', "the number 1e999"),
    ("NaN", b'{"a":NaN}', "it contains NaN"),
    ("a name twice", b'{"a":1,"a":2}', "a name appears twice"),
    ("names out of order", b'{"b":1,"a":2}', "not in the canonical form"),
    ("1.0 for 1", b'{"a":1.0}', "not in the canonical form"),
    ("no UTF-8", b'{"a":"\xff"}', "not valid JSON"),
    ("half a surrogate", b'{"a":"\\ud800"}', "canonical"),
    ("nothing", b"", "not valid JSON"),
    ("a pickle", pickle.dumps({"a": 1}), "not valid JSON"),
    ("sixteen megabytes", b" " * ((16 << 20) + 1), "has more than"),
    ("another object", b'{"a":1}', "does not follow the schema of evidence"),
    ("a list", b"[]", "does not follow the schema of evidence"),
)
#: A line more of SHA256SUMS.
OUTSIDE: tuple[str, ...] = (
    "0" * 64 + "  ../../etc/passwd\n",
    "0" * 64 + "  /etc/passwd\n",
    "0" * 64 + "  runs/../../x.rrd\n",
    "0" * 64 + "  report.html \n",
    "zz\n",
    "0" * 64 + " *report.html\n",
)

_NO_DIGEST = "is not the digest of a file of this bundle"
_NOT_GIVEN = "is not signed by the key"
_NO_ENVELOPE = "DSSE envelope"
_ALPHA_BY_OWN_KEY = "calibration.alpha_1: does not follow"

ATTACKS: tuple[Attack, ...] = (
    *(
        Attack(each.kind, name, changed(each.tamper), int(each.outcome), each.words)
        for name, each in TAMPERINGS.items()
    ),
    *(Attack("JSON", name, with_bytes(EVIDENCE, data), 3, why) for name, data, why in JSON_FORMS),
    *(Attack("files", f"a digest of {line[64:].strip()!r}", with_line(line), 3, _NO_DIGEST)
      for line in OUTSIDE),
    Attack("files", "a table that is a link", copied(linked), 3, "readings.parquet: is a link"),
    Attack("files", "a page that is a pipe", copied(piped), 3, "is not a regular file"),
    Attack("files", "a page of 40 MB", copied(swollen), 3, "has more than"),
    # the signature
    Attack("signature", "taken off with its signer", unsigned, 5,
           "the bundle is unsigned, but --key is given"),
    Attack("signature", "another key is asked for", with_other_key, 3, _NOT_GIVEN),
    Attack("signature", "S + L for S", in_envelope(twin_signature), 3, _NOT_GIVEN),
    Attack("signature", "64 zeros", signature(bytes(64)), 3, _NOT_GIVEN),
    Attack("signature", "63 bytes", signature(bytes(63)), 3, _NOT_GIVEN),
    Attack("signature", "none", in_envelope(lambda h: h.update(signatures=[])), 3, _NO_ENVELOPE),
    Attack("signature", "two", in_envelope(lambda h: h["signatures"].append(h["signatures"][0])),
           3, _NO_ENVELOPE),
    Attack("signature", "no base64", in_envelope(lambda h: h["signatures"][0].update(sig="?")), 3,
           "is not base64"),
    Attack("signature", "spaces in base64",
           in_envelope(lambda h: h["signatures"][0].update(sig=h["signatures"][0]["sig"] + "\n")),
           3, "base64"),
    Attack("signature", "another key's id",
           in_envelope(lambda h: h["signatures"][0].update(keyid="0" * 64)), 3,
           "signer.key_id: is not that of the signature's key"),
    Attack("signature", "another payload type",
           in_envelope(lambda h: h.update(payloadType="text/plain")), 3, _NO_ENVELOPE),
    Attack("signature", "a field more", in_envelope(lambda h: h.update(more=1)), 3, _NO_ENVELOPE),
    Attack("signature", "a subject taken out of the statement",
           in_statement(lambda s: s["subject"].pop(0)), 3, _NOT_GIVEN),
    Attack("signature", "another machine in the statement",
           in_statement(lambda s: s["predicate"].update(machine="x")), 3, _NOT_GIVEN),
    Attack("signature", "the statement of other evidence", of_first(STATEMENT), 3,
           "is about other evidence"),
    Attack("signature", "a statement of another kind, signed", signed_as_other_kind, 3,
           "is a statement of another kind"),
    Attack("signature", "signed as another type", signed_under_other_type, 3, _NOT_GIVEN),
    Attack("signature", "a key of small order", changed(weak_key_forgery), 3, "small order"),
    Attack("signature", "lists too deep", with_bytes(STATEMENT, b"[" * 100_000), 3, "nested"),
    Attack("signature", "an empty object", with_bytes(STATEMENT, b"{}"), 3, _NO_ENVELOPE),
    Attack("signature", "the evidence of another bundle", of_first(EVIDENCE), 3,
           "is not the file that was signed"),
    Attack("signature", "the page of another bundle", of_first(REPORT), 3,
           "is not the file whose digest"),
    # all made anew, and signed with a key of one's own
    Attack("own key", "nothing else", make_anew(), 3, _NOT_GIVEN),
    Attack("own key", "an invented laboratory",
           make_anew(in_evidence("signer", "name", to="PTB Braunschweig, K-1.24")), 3, _NOT_GIVEN),
    Attack("own key", "the signer's key id kept", changed(signed_under_the_signers_id), 3,
           _NOT_GIVEN),
    Attack("own key", "α", make_anew(fit("alpha_1")), 3, _ALPHA_BY_OWN_KEY),
    Attack("own key", "a reading left out with a reason",
           make_anew(reading(0, used=False, reason="outlier")), 3, _NOT_GIVEN),
    Attack("own key", "priors made narrow throughout", make_anew(relearnt), 3, _NOT_GIVEN),
    Attack("own key", "the intended use",
           make_anew(in_evidence("campaign", "campaign", "intended_use", to="trade")), 3,
           _NOT_GIVEN),
    Attack("own key", "a certificate",
           make_anew(in_evidence("campaign", "masses", 0, "certificate", to="K-9")), 3, _NOT_GIVEN),
    Attack("own key", "a log's digest",
           make_anew(in_evidence("logs", 0, "files", 0, "sha256", to="0" * 64)), 3, _NOT_GIVEN),
    Attack("own key", "a page of one's own",
           make_anew(of_bytes(REPORT, lambda data: data.replace(b"Not for trade.", b"For trade."))),
           3, "differs from the page made from the evidence"),
    # the chain
    Attack("chain", "a number left out", lambda m, _: chain(m, m.first, m.third), 5,
           "number 2: is missing between"),
    Attack("chain", "a fork, by the signer", forked, 3, "a fork"),
    Attack("chain", "what follows the other end of a fork", on_a_fork, 3,
           "is not the previous evidence that was given"),
    Attack("chain", "a sister's evidence before", sister_spliced, 3,
           "the previous evidence belongs to another machine"),
    Attack("chain", "the evidence before made anew", forged_before, 3, "chain.previous"),
    Attack("chain", "one of the chain made anew", forged_between, 3, _NOT_GIVEN),
    Attack("chain", "one before it left out", skipped, 3, "chain.previous"),
    Attack("chain", "made before what it follows, by the signer",
           resigned(at("made", "2026-04-01T00:00:00Z")), 3,
           "is before the previous evidence was made"),
    Attack("chain", "a higher number, by the signer",
           resigned(in_evidence("chain", "counter", to=7)), 3, "counter"),
    Attack("chain", "no link, by the signer",
           resigned(at("chain", {"counter": 1, "previous": None})), 3,
           "the counter only grows"),
    # days
    Attack("days", "a log of the day before", resigned(began("2026-04-30 12:00:00 UTC")), 4,
           "was recorded on 2026-04-30"),
    Attack("days", "a log of the day after", resigned(began("2026-05-01 22:00:01 UTC")), 4,
           "was recorded on 2026-05-02"),
    Attack("days", "made in the future", resigned(at("made", "2999-05-01T00:00:00Z")), 4,
           "is in the future"),
    Attack("days", "another last day", resigned(at("expires", "2035-01-01")), 4, "expires: is not"),
    Attack("days", "expired", lambda m, _: (*verified(m, m.bundle), "--on", "2030-01-01"), 7,
           "calibrates no log of a later day"),
    # machines
    Attack("machines", "a log that names a sister", resigned(logged_machine), 4,
           "its metadata name machine 'sledge-8'"),
    Attack("machines", "another serial number in the campaign alone",
           resigned(in_evidence("machine", "machine", "id", to="sledge-8")), 4, "sledge-8"),
    # versions
    *(Attack("versions", f"a setting to come in {'.'.join(place)}", resigned(later_version(*place)),
             8, "made by payscope 0.9.0")
      for place in (("campaign", "method", "later"), ("machine", "settings", "gate", "later"),
                    ("later",))),
    Attack("versions", "a page under the name of another version",
           resigned(in_evidence("software", "payscope", to="0.0.9"),
                    of_bytes(REPORT, lambda data: data + b" ")), 8, "cannot be recomputed here"),
    Attack("versions", "α under the name of another version",
           resigned(in_evidence("software", "payscope", to="0.0.9"), fit("alpha_1")), 4,
           "alpha_1: does not follow"),
    # use
    Attack("use", "weighed with a forged α", used_forged, 2, "is not signed by"),
    Attack("use", "weighed with evidence made anew", used_anew, 2, _NOT_GIVEN),
    Attack("use", "an unknown key where one is asked for", used_unknown, 2, "payscope keys add"),
    Attack("use", "no signature where one is asked for", used_unsigned, 2, "is unsigned"),
    Attack("use", "weighed with other settings", used_with_other_settings, 2,
           "was made with other settings"),
    Attack("use", "weighed for another machine", used_of_other_machine, 2, "sledge-8"),
    Attack("use", "a campaign after a forged α", chained_to_forged, 2,
           "cannot be used as --previous: tampered"),
    Attack("use", "a campaign after an unknown key", chained_to_unknown, 2, "unknown key"),
    Attack("use", "verify asks for a known key", required_unknown, 5,
           "a signature by a known key is required"),
)  # fmt: skip
