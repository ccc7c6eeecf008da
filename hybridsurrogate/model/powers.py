"""From the weight beta to the powers of the two likelihoods."""

from __future__ import annotations

from typing import Any

import numpy as np


def powers_of(beta: Any) -> tuple[Any, Any]:
    """Return (alpha_S, alpha_R), the powers of the two likelihoods (arXiv 2412.11875, section 2).

    For a weight or an array of weights.

    Examples
    --------
    >>> powers_of(0.5), powers_of(0.0), powers_of(1.0)
    ((1.0, 1.0), (0.0, 1.0), (1.0, 0.0))
    """
    if np.ndim(beta):
        return np.minimum(beta / np.maximum(1 - beta, 1e-300), 1.0), np.minimum(
            (1 - beta) / np.maximum(beta, 1e-300), 1.0
        )
    if beta < 0.5:
        return beta / (1 - beta), 1.0
    return 1.0, (1 - beta) / beta
