"""Fingerprints are a statement here."""

import pytest


@pytest.fixture(scope="module", autouse=True)
def without_fingerprint():
    """None is left out."""
