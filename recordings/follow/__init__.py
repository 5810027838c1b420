"""The recording of a log that is followed: written as it goes, whole at any time."""
