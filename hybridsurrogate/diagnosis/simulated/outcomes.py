"""What a diagnosis would conclude from each of many data sets, by the linearised evidence alone."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special

from hybridsurrogate.diagnosis.search.candidate import NAMELESS, prior_odds
from hybridsurrogate.diagnosis.search.null_test import evidence_at_null
from hybridsurrogate.diagnosis.simulated.place import Place
from hybridsurrogate.effects.base import Cause
from hybridsurrogate.inference.evidence.grid import make_grid
from hybridsurrogate.types import FloatArray

# the word for data sets in which nothing is wrong, or nothing is detected
NOTHING = "none"
# numbers of responses that are evaluated together
_TOGETHER = 2_000_000


class Outcomes(NamedTuple):
    """Conclusions from data sets.

    Attributes
    ----------
    statistic : ndarray of shape (m,)
        T, the log of the best evidence ratio, see `null_test`.
    none : ndarray of shape (m,)
        Probability that nothing is wrong.
    kind : ndarray of str of shape (m,)
        The most probable kind, given that something is wrong.
    share : ndarray of shape (m,)
        Its probability, given that something is wrong.
    """

    statistic: FloatArray
    none: FloatArray
    kind: NDArray[np.str_]
    share: FloatArray

    def between(self, start: int, end: int) -> Outcomes:
        """Return those of some of the data sets."""
        some = slice(start, end)
        return Outcomes(self.statistic[some], self.none[some], self.kind[some], self.share[some])

    def detected(self, limit: float, rate: float) -> NDArray[np.bool_]:
        """Return where something is detected: by the test and by its probability.

        Parameters
        ----------
        limit : float
            What T exceeds in a share ``rate`` of data sets without a cause.
        rate : float
            False alarm rate.
        """
        # the bound of `evidence_bound`, with prior odds of one
        odds = self.none / np.maximum(1 - self.none, np.finfo(float).tiny)
        return ((self.statistic > limit) | (odds <= rate)) & (self.none <= 0.5)


def log_evidence(place: Place, causes: Sequence[Cause], responses: FloatArray) -> FloatArray:
    """Return the log evidence of "nothing is wrong" and of causes for data sets, (m, 1 + k).

    Parameters
    ----------
    place : Place
    causes : sequence of Cause
    responses : ndarray of shape (m, n)
    """
    model, context = place.context.problem.model, place.context
    models = [place.null.model, *(model.with_effects((*model.effects, one)) for one in causes)]
    grids = [place.null.grid, *map(make_grid, models[1:])]
    sizes = context.sizes([place.null])
    pairs = list(zip(models, grids, strict=True))
    return evidence_at_null(context, place.null, pairs, responses, sizes)


def outcomes(place: Place, responses: FloatArray) -> Outcomes:
    """Return what a diagnosis would conclude from data sets (m, n) at a place."""
    pieces = np.array_split(responses, max(-(-responses.size // _TOGETHER), 1))
    evidence = np.concatenate([log_evidence(place, place.causes, some) for some in pieces])
    statistic = np.max(evidence[:, 1:], axis=1) - evidence[:, 0]
    weight = evidence + np.log(prior_odds([None, *place.causes]))
    probability = np.exp(weight - special.logsumexp(weight, axis=1, keepdims=True))
    kind, share = _most_probable(place.causes, probability[:, 1:])
    return Outcomes(statistic, probability[:, 0], kind, share)


def _most_probable(
    causes: Sequence[Cause], probability: FloatArray
) -> tuple[NDArray[np.str_], FloatArray]:
    """Return the most probable kind of each data set, as `Search.leader`, and its share."""
    total = np.maximum(np.sum(probability, axis=1, keepdims=True), np.finfo(float).tiny)
    kinds, of_kind = _summed([one.kind for one in causes], probability / total)
    families, of_family = _summed([one.concerns for one in causes], probability / total)
    has = {(one.concerns, one.kind) for one in causes}
    member = np.array([[(family, kind) in has for kind in kinds] for family in families])
    among = np.where(member[np.argmax(of_family, axis=1)], of_kind, -1.0)
    best = np.argmax(among, axis=1)
    # a curve of any shape, where it beats every kind
    nameless = np.isin(kinds, NAMELESS)[best]
    best = np.where(nameless, np.argmax(of_kind, axis=1), best)
    return np.array(kinds)[best], np.take_along_axis(of_kind, best[:, None], axis=1)[:, 0]


def _summed(names: Sequence[str], values: FloatArray) -> tuple[list[str], FloatArray]:
    """Return the different names, and the values (m, k) of each name summed."""
    different = list(dict.fromkeys(names))
    belongs = np.array([[name == other for other in different] for name in names], dtype=float)
    return different, values @ belongs
