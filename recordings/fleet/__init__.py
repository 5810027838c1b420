"""The page of a fleet: machines and weeks, drift, what needs a look."""
