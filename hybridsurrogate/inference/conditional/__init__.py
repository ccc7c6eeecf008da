"""Step 2: unknowns given each draw of the surrogate's coefficients.

sampler           chooses among the ways below; moves, for likelihoods that are not normal
grid              one or two parameters; proposals of each coefficient draw's own
pairwise_squares  residuals of all pairs of proposals and coefficients
"""
