"""The answer's fit: the equation of straight motion with nuisance terms under stated priors.

`equation` (the columns as they are before the moving mean, and the manoeuvres they come from) ←
`nuisances` (the one table of terms) ← `averages` (the columns' means) and `kinematics` (wheels
against accelerometer) ← `fit_task` (one fit) ← `joint_fit` (load states, ground, drifts) ← `weigh`
← `budget` ← `loads` (the frames).
"""
