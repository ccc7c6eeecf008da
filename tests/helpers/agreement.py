"""When two computations are taken to give the same numbers."""

import numpy as np


def assert_same_numbers(a, b, rtol=1e-9):
    """Check arrays that are equal but for rounding: the same sum along another path.

    A path is another where arrays have other shapes, rows another order, or a library chooses its
    kernels by the processor. Rounding is relative to the largest number, as differences of large
    ones are small, and 1e-9 leaves seven digits for how a condition number multiplies it.
    """
    a, b = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
    finite = np.abs(b[np.isfinite(b)])
    np.testing.assert_allclose(a, b, rtol=0, atol=rtol * finite.max(initial=0.0))
