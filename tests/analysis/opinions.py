"""Verdicts that were not read off a log."""

from analysis.model.verdict import Check, Verdict

WEIGHS = Verdict()
CANNOT_WEIGH = Verdict((Check("r_squared", "mass", 0.1, 0.5, None, False, "made up"),))
