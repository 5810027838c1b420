"""Recording of a followed log, complete at any time while it grows."""
