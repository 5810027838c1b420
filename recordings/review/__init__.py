"""Review of a shift: ledger, page, and verdicts of reviewers on its cycles."""
