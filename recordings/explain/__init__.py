"""An explanation of a run in words and as a picture."""
