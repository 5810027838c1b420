"""Page of a fleet: machines and weeks, drift, and recordings to check."""
