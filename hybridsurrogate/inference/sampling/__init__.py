"""Starts, modes and draws of a density of few dimensions.

modes           where optimisers start, Newton's method from all, Gaussians at the ends
axis_proposals  narrow proposals along an unknown with jumps, and along bent ridges
importance      rounds of importance sampling, weighted as one mixture
ensembles       the ensemble sampler with its stopping rule, and many chains at once
hierarchical    coordinates of hierarchies
settings        the numbers that all of them are tuned by
"""
