"""Force, acceleration and phase of the smoothed motion."""
