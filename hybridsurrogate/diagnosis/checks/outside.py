"""How probable the leading cause is, where causes that the catalogue does not hold count as well.

The probabilities of a search suppose that what is at fault is in the catalogue, and no test can see
from the data what a curve that fits as well would be called. How often that misleads is counted:
blind cases of 29 forms with their kind in the catalogue, and with it taken out, in the proportion
in which measured data sets with a documented cause are of either sort. A logistic regression on
them says how often the leading cause is the right one.
"""

from __future__ import annotations

import math

# of 16 measured data sets with a documented cause (docs/measured_data.md) 7 had one that the
# catalogue does not hold
NOT_HELD, DOCUMENTED = 7, 16
# blind cases of `python -m examples.scorecard` (sizes 2 and 4, 40 and 100 rows, seeds 510000 to
# 510007, half of them --outside) that the regression describes, and its coefficients: of one, of
# the log odds within the catalogue, of the log probability of a remainder, and of leaving
# structure. In tenfold cross-validation the remainder gains 0.059 (standard error 0.011) in the
# mean log score, and structure 0.008 (0.005) beside it; the residuals' p-value, the rows and the
# evidence against a smooth curve gain no more than their standard error
N_CASES = 896
_ONE, _ODDS, _REMAINDER, _STRUCTURE = -3.26, 0.262, -0.796, -1.13
# log odds and log probabilities beyond these are all the same: no case was surer
_SUREST, _LEAST = 9.2, 1e-3


def probability_right(share: float, remainder: float, leaves_structure: bool) -> float:
    """Return the probability that the leading cause is the right one.

    Parameters
    ----------
    share : float
        Probability of its kind within the catalogue, given that something is wrong.
    remainder : float
        Probability that a smooth remainder is needed beside it.
    leaves_structure : bool
        Whether the verdict is "nearest".

    Returns
    -------
    float
        Never more than ``share``.

    Examples
    --------
    >>> sure, unsure = probability_right(0.99, 0.02, False), probability_right(0.6, 0.1, False)
    >>> unsure < sure < 0.99
    True
    """
    odds = math.log(share) - math.log1p(-share) if 0 < share < 1 else math.copysign(_SUREST, share)
    odds = min(max(odds, -_SUREST), _SUREST)
    total = _ONE + _ODDS * odds + _REMAINDER * math.log(min(max(remainder, _LEAST), 1.0))
    total += _STRUCTURE * leaves_structure
    return min(share, 1 / (1 + math.exp(-total)))
