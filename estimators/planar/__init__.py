"""Motion in the plane: regressor rows, and which parameters they determine."""
