"""The commands `calibrate` and `verify`, and evidence put to use."""
