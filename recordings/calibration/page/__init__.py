"""A page that checks evidence in a browser, by a program that is not ours of Python."""
