"""Likelihoods: one file a family, which registers its names."""

from typing import TYPE_CHECKING

from hybridsurrogate.exceptions import did_you_mean
from hybridsurrogate.likelihoods.base import LIKELIHOODS, Likelihood
from hybridsurrogate.likelihoods.contaminated import Contaminated
from hybridsurrogate.likelihoods.custom import CustomLikelihood
from hybridsurrogate.likelihoods.normal import TransformedNormal
from hybridsurrogate.registration import import_all

import_all(__name__)

# what a file registers is public
_CLASSES = {type(likelihood).__name__: type(likelihood) for likelihood in LIKELIHOODS.values()}
globals().update(_CLASSES)
__all__ = [
    "LIKELIHOODS",
    "Contaminated",
    "CustomLikelihood",
    "Likelihood",
    "TransformedNormal",
    "as_likelihood",
    *_CLASSES,
]

if TYPE_CHECKING:  # for type checkers and editors, which do not run the loop
    from hybridsurrogate.likelihoods.beta_binomial import BetaBinomial as BetaBinomial
    from hybridsurrogate.likelihoods.binomial import Binomial as Binomial
    from hybridsurrogate.likelihoods.counts import NegativeBinomial as NegativeBinomial
    from hybridsurrogate.likelihoods.counts import Poisson as Poisson
    from hybridsurrogate.likelihoods.normal import LogNormal as LogNormal
    from hybridsurrogate.likelihoods.normal import Normal as Normal
    from hybridsurrogate.likelihoods.student_t import StudentT as StudentT


def as_likelihood(likelihood: str | Likelihood) -> Likelihood:
    """Return the likelihood object for a name, or the object itself.

    Parameters
    ----------
    likelihood : str or Likelihood
        "normal", "lognormal", "student-t", "negative-binomial", "poisson", "binomial" (one
        trial a row; ``Binomial(trials)`` and ``BetaBinomial(trials)`` take several), or any other
        name in `LIKELIHOODS`; or an object.

    Returns
    -------
    Likelihood

    Examples
    --------
    >>> as_likelihood("lognormal").log_scale
    True
    """
    if isinstance(likelihood, Likelihood):
        return likelihood
    try:
        return LIKELIHOODS[likelihood]
    except (KeyError, TypeError):
        raise ValueError(
            f"likelihood must be one of {sorted(LIKELIHOODS)} or a Likelihood object, "
            f"got {likelihood!r}.{did_you_mean(likelihood, LIKELIHOODS)}"
        ) from None
