"""An explanation in words and in a picture."""
