"""The paper's tables, figures and claims found anew by simulation: frames, and sentences on them.

`paper` holds what the paper prints, `bounds` and `intervals` what numbers are judged by; the other
files make one table or claim each.
"""
