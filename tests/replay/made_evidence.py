"""Three bundles of one machine, each chained to the one before, and what they were made of."""

import sys
from pathlib import Path
from typing import Any

import pytest

from replay.calibration.calibrate_campaign import calibrate_from_campaign
from replay.calibration.verify_bundle import Verification, verify_bundle
from tests.replay.attacker import key_files
from tests.replay.sledge_campaign import campaign_folder

#: Of the bundle after the one that is looked at: half the replays. The one before is of the same
#: priors, or its line says nothing of the points.
ALIKE = "\n[method]\nlearn = false\n"
LIMITS = '\n[decision]\naccuracy_class = "OIML R 134 10"\n'


class Made:
    """The bundles `first`, `bundle` and `third`, the keys and the campaign with its logs."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.private, self.public = folder / "key.pem", folder / "key.pub.pem"
        self.campaign = folder / "campaign" / "campaign.toml"
        self.first, self.bundle, self.third = (folder / n for n in ("first", "second", "third"))

    def verify(self, bundle: Path, **more: Any) -> Verification:
        return verify_bundle(bundle, key_file=self.public, previous=self.first, **more)


def write_evidence(folder: Path) -> None:
    """Write what `Made` has."""
    made = Made(folder)
    key_files(folder)
    campaign_folder(made.campaign.parent, extra=LIMITS)
    alike = made.campaign.with_name("alike.toml")
    alike.write_text(made.campaign.read_text() + ALIKE)
    bundles = ((made.first, made.campaign), (made.bundle, made.campaign), (made.third, alike))
    before: Path | None = None
    for target, campaign in bundles:
        with pytest.MonkeyPatch.context() as patched:
            if target != made.bundle:  # of the others nobody reads the PDF
                patched.setitem(sys.modules, "weasyprint", None)
            calibrate_from_campaign(campaign, target, key_file=made.private, previous=before)
        before = target


def items(found: Verification) -> str:
    return "\n".join(map(str, found.findings))
