"""Spins, arcs and motion of both at once (stages 2 and 3): inertia, centre of mass, their budget.

`planar` fits what turns, with the terms of `terms` under their priors; `budget` says what the
uncertainty is made of.
"""
