"""Use of a calibration on later logs: masses, drift, error limits, learnt priors."""
