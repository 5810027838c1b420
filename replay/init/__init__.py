"""The commands `info` and `init`: what a log holds, and first files made of it."""
