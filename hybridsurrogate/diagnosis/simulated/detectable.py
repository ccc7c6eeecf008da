"""The smallest size of each kind of cause that a finished search would have detected."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from scipy import special

from hybridsurrogate.diagnosis.search.candidate import prior_odds
from hybridsurrogate.diagnosis.search.null_test import NullTest
from hybridsurrogate.diagnosis.search.search import Search
from hybridsurrogate.diagnosis.simulated.hidden import Shapes, hidden, shapes_of
from hybridsurrogate.diagnosis.simulated.outcomes import log_evidence
from hybridsurrogate.diagnosis.simulated.place import Place
from hybridsurrogate.effects.base import Cause
from hybridsurrogate.types import FloatArray

# share of the data sets in which a cause counts as detectable
POWER = 0.9
# sizes, in standard deviations of the mean of 40 rows, and data sets of each
_SIZES, _SETS = np.geomspace(0.5, 8.0, 5) * np.sqrt(40), 20
# changes of a row between which it is interpolated
_CHANGES = 60


def detectable(result: Search, test: NullTest, rate: float) -> pd.DataFrame:
    """Return the smallest size of each kind that would have been detected in these rows.

    Data sets with a cause of each kind are evaluated by the evidence of that kind and of "nothing
    is wrong" alone: another kind may show a smaller one.

    Parameters
    ----------
    result : Search
        The first one, which detected nothing.
    test : NullTest
        Of it.
    rate : float
        False alarm rate.

    Returns
    -------
    DataFrame
        One row a kind, see `DiscrepancyDiagnosis`.
    """
    # a fixed stream: a verdict is reproducible
    random = np.random.RandomState(0)
    causes = [w.cause for w in result.candidates if w.cause is not None]
    place = Place.of(result.context, result.candidates[0].fit, causes)
    limit = float(np.quantile(test.replicates, 1 - rate, method="higher"))
    log_prior = np.log(prior_odds([None, *causes]))
    levels, rows = _SIZES / np.sqrt(len(place.noise)), []
    for kind in dict.fromkeys(one.kind for one in place.causes):
        own = [one for one in place.causes if one.kind == kind]
        prior = log_prior[[0, *(1 + causes.index(one) for one in own)]]
        forms = [(one, shapes_of(place, one, random)) for one in own]
        drawn = [(size, hidden(place, forms, float(size), _SETS, random)) for size in levels]
        made = [(size, one) for size, one in drawn if one is not None]
        if not made:
            continue
        evidence = log_evidence(place, own, np.concatenate([one.responses for _, one in made]))
        better = np.max(evidence[:, 1:], axis=1) - evidence[:, 0] > limit
        odds = special.logsumexp(evidence[:, 1:] + prior[1:], axis=1) - evidence[:, 0] - prior[0]
        seen = (better & (odds >= 0)).reshape(len(made), _SETS)
        sizes, share = np.array([size for size, _ in made]), np.mean(seen, axis=1)
        rows.append((kind, size_at(sizes, share, POWER), _change_at(forms, sizes, share)))
    return pd.DataFrame(rows, columns=["kind", "size", "change"])


def _change_at(forms: Sequence[tuple[Cause, Shapes]], sizes: FloatArray, rate: FloatArray) -> float:
    """Return the largest change of a row of which a cause is detected with `POWER`.

    A step of some height has many sizes, as the parameters follow one place more than another: its
    rate is the average of those at these sizes.
    """
    peak = np.concatenate([np.max(np.abs(one.curves), axis=1) for _, one in forms])
    odds = prior_odds([cause for cause, _ in forms])
    weight = np.concatenate([k * one.weight for k, (_, one) in zip(odds, forms, strict=True)])
    peak, weight = peak[weight * peak > 0], weight[weight * peak > 0]
    if not len(peak):
        return np.nan
    changes = np.geomspace(sizes[0] * peak.min(), sizes[-1] * peak.max(), _CHANGES)
    log_sizes, rising = np.log(sizes), np.maximum.accumulate(rate)
    at = np.interp(np.log(changes[:, None] / peak), log_sizes, rising)
    return size_at(changes, at @ weight / weight.sum(), POWER)


def size_at(sizes: FloatArray, rate: FloatArray, power: float) -> float:
    """Return where a rate over size rises to a power, NaN where it does not.

    Interpolated on a logarithmic scale of size, as a curve that never falls; the smallest size
    where the rate is as high there.

    Parameters
    ----------
    sizes, rate : ndarray of shape (k,)
        Sizes in rising order.
    power : float

    Examples
    --------
    >>> import numpy as np
    >>> size_at(np.array([1.0, 4.0]), np.array([0.5, 1.0]), 0.75)
    2.0
    """
    size, rate = np.log(sizes), np.maximum.accumulate(rate)
    if rate[-1] < power:
        return np.nan
    k = int(np.argmax(rate >= power))
    if not k:
        return float(sizes[0])
    share = (power - rate[k - 1]) / (rate[k] - rate[k - 1])
    return float(np.exp(size[k - 1] + share * (size[k] - size[k - 1])))
