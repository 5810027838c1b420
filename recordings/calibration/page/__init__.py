"""A page that checks evidence in a browser, by a program independent of this one in Python."""
