"""The stages of a replay, from channels to masses; each is a pure function of frames."""
