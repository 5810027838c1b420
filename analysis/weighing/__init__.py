"""The answer's fit: the equation of straight motion with nuisance terms under stated priors.

`motion_samples` (the columns before the moving mean, and their manoeuvres) ← `nuisances` (the one
table of terms) ← `fit_columns` (means of the columns) and `wheel_comparison` (wheels against
accelerometer) ← `fit_task` (one fit) ← `joint_fit` (the rounds of the fit) and `load_search` (load
states) ← `weigh` ← `mass_budget` ← `load_frames` and `nuisance_frames` (the frames).
"""
