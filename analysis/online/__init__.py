"""On board: gate and estimators one row at a time."""
