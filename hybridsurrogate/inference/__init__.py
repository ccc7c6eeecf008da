"""From a model and its rows to draws and their evidence.

conjugate    coefficients integrated out in closed form
laplace      the same by Laplace's approximation, for any likelihood
evidence     the linearised evidence of a cause on a grid: what a search screens by
sampling     starts, modes, adaptive importance sampling, emcee
conditional  step 2: unknowns given each draw of the coefficients

posterior_sampler  step 1: draws, k-hat and log evidence of any target
procedure          both steps of the procedure, from a problem or a neighbour's proposals
loo                leave-one-out of a power-scaled posterior
"""
