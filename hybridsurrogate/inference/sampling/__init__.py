"""Starts, modes and draws of a density of few dimensions.

initial_points          where optimisers start
modes                   Newton's method from all starts, Gaussians at the ends
axis_proposals          narrow proposals along an unknown with jumps
ridges                  coordinates in which a bent ridge is straight
proposals               mixtures of Student-t densities
adaptive_importance     rounds of importance sampling, weighted as one mixture
psis                    Pareto-smoothed weights and k-hat
moment_matching         proposals moved to another density
emcee_sampler           the ensemble sampler, with a stopping rule
differential_evolution  its moves for many chains at once
settings                the numbers that all of them are tuned by
"""
