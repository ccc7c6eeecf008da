"""Predictions from mixtures of posteriors.

mixture        means, variances, densities, samples and central intervals
leave_one_out  leave-one-out scores of the rows given to fit
variables      draws by name with their priors, estimates as a table
"""
