"""Build the page that checks a bundle in a browser: one file, from the parts in this folder.

The page checks digests and signature, and computes line and uncertainty, in JavaScript and without
a network. It has the same bytes for every bundle, so that its digest can be published.
"""

import base64
import hashlib
from importlib.metadata import version
from pathlib import Path
from typing import Final

NAME: Final = "payscope-verifier.html"
#: Scripts, each after those that it needs.
_SCRIPTS: Final = (
    "bytes.js",
    "sha2.js",
    "ed25519.js",
    "weak_keys.js",
    "canonical_json.js",
    "parquet.js",
    "matrices.js",
    "distributions.js",
    "campaign_points.js",
    "line_fit.js",
    "uncertainty.js",
    "printed_numbers.js",
    "bundle_files.js",
    "signature.js",
    "check_bundle.js",
    "verifier_view.js",
)
_PAGE: Final = "verifier.html"
_STYLE: Final = "verifier.css"


def build_verifier_page() -> bytes:
    """Build the page; a given version always makes the same bytes."""
    style = f"\n{_read_page_source(_STYLE)}"
    script = "\n".join(('"use strict";', *(_read_page_source(name) for name in _SCRIPTS)))
    page = _read_page_source(_PAGE)
    parts = {
        "version": version("payscope"),
        "style_hash": _compute_content_security_digest(style),
        "script_hash": _compute_content_security_digest(script),
        "style": style,
        "script": script,
    }
    for name, text in parts.items():
        page = page.replace(f"{{{name}}}", text, 1)
    return page.encode()


def compute_verifier_page_sha256() -> str:
    """Compute the SHA-256 of the page, in hex."""
    return hashlib.sha256(build_verifier_page()).hexdigest()


def _read_page_source(file_name: str) -> str:
    return Path(__file__).with_name(file_name).read_text(encoding="utf-8")


def _compute_content_security_digest(text: str) -> str:
    """Compute the digest of a text by which the content security policy permits only this text."""
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
