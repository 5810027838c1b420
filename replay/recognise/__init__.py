"""What the columns of a log are: by their names, units, ranges and how they go with each other."""
