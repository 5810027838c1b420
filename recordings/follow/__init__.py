"""Recording of a followed log, which can be read at any time while it grows."""
