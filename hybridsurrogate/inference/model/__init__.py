"""How measured rows follow from the simulation, before any data.

effects             what causes do to rows
observation         surrogate, causes and priors wired into arrays
validation          what a cause returns, checked by name
disjoint_moves      unknowns that share a run where slopes are taken
finite_differences  how rough a simulation is, and steps it can be differenced by
working_point       any likelihood expanded into normal rows
prior_density       of the standard normal unknowns and sigma
power_scaling       powers of the two likelihoods from beta
"""
