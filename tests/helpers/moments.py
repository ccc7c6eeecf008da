"""Whether draws have the moments that they should."""

import numpy as np


def assert_gaussian(draws, mean, covariance, error=5.0):
    """Moments of draws agree with a Gaussian within their Monte Carlo error."""
    n, d = draws.shape
    whitened = np.linalg.solve(np.linalg.cholesky(covariance), (draws - mean).T)
    assert np.abs(whitened.mean(axis=1)).max() < error / np.sqrt(n)
    np.testing.assert_allclose(np.cov(whitened), np.eye(d), atol=error * np.sqrt(2 / n))
