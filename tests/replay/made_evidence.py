"""Three bundles of one machine, each chained to the one before, and what they were made of."""

from pathlib import Path
from typing import Any

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
        self.private, self.public = key_files(folder)
        self.campaign = campaign_folder(folder / "campaign", extra=LIMITS)
        alike = self.campaign.with_name("alike.toml")
        alike.write_text(self.campaign.read_text() + ALIKE)
        self.first, self.bundle, self.third = (folder / n for n in ("first", "second", "third"))
        before: Path | None = None
        of_each = (self.campaign, self.campaign, alike)
        for made, of in zip((self.first, self.bundle, self.third), of_each, strict=True):
            calibrate_from_campaign(of, made, key_file=self.private, previous=before)
            before = made

    def verify(self, bundle: Path, **more: Any) -> Verification:
        return verify_bundle(bundle, key_file=self.public, previous=self.first, **more)


def items(found: Verification) -> str:
    return "\n".join(map(str, found.findings))
