"""The machine on a straight line, integrated in fixed steps."""
