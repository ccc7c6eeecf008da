"""Likelihoods: one file a family."""

from hybridsurrogate.likelihoods.base import Likelihood
from hybridsurrogate.likelihoods.binomial import Binomial
from hybridsurrogate.likelihoods.contaminated import Contaminated
from hybridsurrogate.likelihoods.counts import NegativeBinomial, Poisson
from hybridsurrogate.likelihoods.custom import CustomLikelihood
from hybridsurrogate.likelihoods.normal import LogNormal, Normal, TransformedNormal
from hybridsurrogate.likelihoods.student_t import StudentT

__all__ = [
    "Binomial",
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

LIKELIHOODS: dict[str, Likelihood] = {
    "normal": Normal(),
    "lognormal": LogNormal(),
    "student-t": StudentT(),
    "negative-binomial": NegativeBinomial(),
    "poisson": Poisson(),
    "binomial": Binomial(),
}


def as_likelihood(likelihood: str | Likelihood) -> Likelihood:
    """Return the likelihood object for a name, or the object itself.

    Parameters
    ----------
    likelihood : str or Likelihood
        "normal", "lognormal", "student-t", "negative-binomial", "poisson", "binomial" (one
        trial a row), or an object.

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
            f"got {likelihood!r}."
        ) from None
