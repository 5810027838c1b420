"""Inputs of a replay: merge logs, place them on one time line, and cache decoded ones."""
