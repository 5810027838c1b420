"""The track of a machine, thinned for a page."""

from typing import Final

import polars as pl

#: Points of the track.
_TRACK_POINTS: Final = 400


def track_of(aligned: pl.DataFrame) -> pl.DataFrame | None:
    """Some positions of the frame `aligned`, None where it has none."""
    names = ("latitude_deg", "longitude_deg")
    if not set(names) <= set(aligned.columns):
        return None
    known = aligned.select(names).drop_nulls()
    return known.gather_every(max(known.height // _TRACK_POINTS, 1))
