"""How probable the most probable cause is, where causes outside the catalogue count as well.

The probabilities of a search suppose that the true cause is in the catalogue. No test of the data
can name a curve that fits as well. How often that misleads was counted on
blind cases with their kind in the catalogue and with it taken out, alone and together with a
further, smaller fault. Each is as frequent as among measured data sets. A logistic regression on
them predicts how often the most probable cause is the right one.
"""

from __future__ import annotations

import math

from hybridsurrogate.studied import STUDIED

# of the measured data sets with a documented cause (docs/evidence/measured_data.md) some had one
# that the catalogue does not hold; coefficients of one, of the log odds within the catalogue, and
# of residual structure. In tenfold cross-validation the latter gains 0.014 (standard error 0.007)
# in the mean log score; the probability of a remainder gains 0.006 (0.006) more, the residuals'
# p-value, the rows and the evidence against a smooth curve no more than their standard error
_FOUND = STUDIED["probability_right"]
NOT_HELD, DOCUMENTED, N_CASES = (_FOUND[name] for name in ("not_held", "documented", "n_cases"))
_ONE, _ODDS, _STRUCTURE = (_FOUND[name] for name in ("one", "odds", "structure"))
# log odds beyond it are all the same: no case was surer
_SUREST = 9.2


def probability_right(share: float, has_residual_structure: bool) -> float:
    """Return the probability that the most probable cause is right, given that something is wrong.

    Parameters
    ----------
    share : float
        Probability of its kind within the catalogue, given that something is wrong.
    has_residual_structure : bool
        Whether the verdict is "nearest".

    Returns
    -------
    float
        Never more than ``share``.

    Examples
    --------
    >>> sure, unsure = probability_right(0.99, False), probability_right(0.6, False)
    >>> unsure < sure < 0.99
    True
    """
    odds = math.log(share) - math.log1p(-share) if 0 < share < 1 else math.copysign(_SUREST, share)
    odds = min(max(odds, -_SUREST), _SUREST)
    total = _ONE + _ODDS * odds + _STRUCTURE * has_residual_structure
    return min(share, 1 / (1 + math.exp(-total)))
