"""What `payscope init` proposes for `[settings.priors]`, where the log is rich enough to say."""

import tomllib
from typing import Final

from analysis.check import Verdict
from analysis.machine import Machine
from analysis.run import Run
from estimators.errors import PayscopeError
from replay.pipeline import run
from replay.readers import Log

#: The setting of each term's prior.
_SETTINGS: Final = {
    "const": "const_share",
    "lag": "lag_s",
    "lag_drift": "lag_drift_s",
    "quadratic": "quadratic_share",
    "direction": "direction_share",
    "load_transfer": "load_transfer_s2_m",
}
#: A log is rich in a term when it would narrow its prior to this share.
_RICH: Final = 0.5


def prior_lines(log: Log, text: str) -> list[str]:
    """Replay a log by its own draft, and propose the priors that it would narrow, as comments.

    Args:
        log: an opened log.
        text: its machine file, complete.

    Returns:
        Lines of a machine file; none where the log cannot weigh or tells no more than the defaults.
    """
    try:
        replayed = run(log, Machine.model_validate(tomllib.loads(text)))
    except (PayscopeError, ValueError):
        return []
    if not Verdict.of(replayed.frames["verdict"]).can_weigh:
        return []
    lines = _proposals(replayed)
    if not lines:
        return []
    return [
        "# If this log may stand for the others of its machine, they may have narrower priors:",
        "# [settings.priors]",
        *lines,
        "",
    ]


def _proposals(replayed: Run) -> list[str]:
    """A line a term: as wide as what was found, and what it is known to."""
    priors = replayed.provenance.settings.priors.model_dump()
    lines: list[str] = []
    for row in replayed.frames["nuisances"].iter_rows(named=True):
        setting = _SETTINGS.get(row["term"])
        found = float((row["posterior"] ** 2 + row["posterior_std"] ** 2) ** 0.5)
        narrowed = found / row["prior_std"]
        if setting is None or narrowed > _RICH:
            continue
        value = f"# {setting} = {priors[setting] * narrowed:.2g}"
        said = f"found {row['posterior']:.2g} ± {row['posterior_std']:.1g} {row['unit']}"
        lines.append(f"{value:<32}# {said}")
    return lines
