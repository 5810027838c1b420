"""The review of a shift: ledger, page, and what a reviewer says of its cycles."""
