"""Likelihoods: each family registers its names."""

from typing import TYPE_CHECKING

from hybridsurrogate.exceptions import did_you_mean
from hybridsurrogate.likelihoods.base import LIKELIHOODS, Likelihood
from hybridsurrogate.likelihoods.censored import Censored
from hybridsurrogate.likelihoods.custom import CustomLikelihood
from hybridsurrogate.likelihoods.normal import TransformedNormal
from hybridsurrogate.likelihoods.student_t import Contaminated
from hybridsurrogate.registration import import_all

if TYPE_CHECKING:  # for type checkers and editors, which do not run `import_all`
    from hybridsurrogate.likelihoods.binomial import BetaBinomial, Binomial
    from hybridsurrogate.likelihoods.counts import NegativeBinomial, Poisson
    from hybridsurrogate.likelihoods.normal import LogNormal, Normal
    from hybridsurrogate.likelihoods.student_t import StudentT

__all__ = [
    "LIKELIHOODS",
    "BetaBinomial",
    "Binomial",
    "Censored",
    "Contaminated",
    "CustomLikelihood",
    "Likelihood",
    "LogNormal",
    "NegativeBinomial",
    "Normal",
    "Poisson",
    "StudentT",
    "TransformedNormal",
    "as_likelihood",
]

import_all(__name__)

# what a file registers is public
_CLASSES = {type(likelihood).__name__: type(likelihood) for likelihood in LIKELIHOODS.values()}
globals().update(_CLASSES)
__all__ += sorted(_CLASSES.keys() - set(__all__))


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
