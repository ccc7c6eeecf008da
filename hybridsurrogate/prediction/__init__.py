"""Predictions from mixtures of posteriors.

mixture        means, variances, densities and samples
intervals      central intervals
cavity         each row given the others, coefficients of causes integrated out
leave_one_out  leave-one-out scores of the rows given to fit
variables      draws by name, with their priors
summary        estimates as a table
"""
