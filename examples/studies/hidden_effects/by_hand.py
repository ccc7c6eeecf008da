"""What a careful engineer does by hand about a simulation that misses something.

Every explanation in the list is fitted by least squares from many starts, parameters bounded by the
support of their priors, and the smallest BIC wins; an explanation pays 2 ln(number of explanations
tried) for the search. It knows nothing of the package's own diagnosis: it is what that is measured
against. ``python -m examples.studies.hidden_effects.rates`` prints how often it is right.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from hybridsurrogate.simulation.simulator import Simulator

from .fits import bic, fit_form, fit_plain
from .forms import forms
from .problem import pose, predict
from .simulations import Array


def diagnose_by_hand(
    simulator: Simulator, X: Array, y: Array, rng: np.random.Generator
) -> dict[str, Any]:
    """Fit every explanation and choose by BIC.

    Parameters
    ----------
    simulator : Simulator
    X : array of shape (n, n_inputs + number of recorded columns that the simulation ignores)
    y : array of shape (n,)
    rng : Generator
        Places the starts.

    Returns
    -------
    dict
        ``kind``, ``target``, ``bic`` (kind and target to BIC with the price of the search),
        ``predict`` and ``predict_none``, functions of X: with what was chosen, and with the
        simulation as it is, calibrated.
    """
    problem = pose(simulator, X, y, rng)
    plain = fit_plain(problem)
    fits = [fit_form(problem, form, plain) for form in forms(simulator, X)]
    search = 2 * np.log(len(fits))
    table = {(plain.form.kind, plain.form.target): (bic(plain, len(y)), plain)}
    for fit in fits:
        # a drift of one parameter along either of two inputs has one name: the better one stays
        key, value = (fit.form.kind, fit.form.target), bic(fit, len(y)) + search
        if key not in table or value < table[key][0]:
            table[key] = (value, fit)
    (kind, target), (_, best) = min(table.items(), key=lambda item: item[1][0])
    return {
        "kind": kind,
        "target": target,
        "bic": {key: value for key, (value, _) in table.items()},
        "predict": lambda X: predict(simulator, best, X),
        "predict_none": lambda X: predict(simulator, plain, X),
    }
