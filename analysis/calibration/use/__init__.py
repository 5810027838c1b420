"""A calibration used on later logs: masses, drift, error limits, learnt priors."""
