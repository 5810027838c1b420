"""The commands `calibrate` and `verify`, and the use of evidence in other commands."""
