"""An answer against the truth, which only the judge knows."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from hidden_effects.cases import SAME_CURVE, Case, rms
from hidden_effects.fits import fit_form, fit_plain
from hidden_effects.forms import KINDS, Form
from hidden_effects.problem import pose
from hidden_effects.rates import judge
from hidden_effects.simulations import Array
from scipy.stats import qmc

from hybridsurrogate.effects.base import Cause, Context

from .calibration import Measurements, calibrate
from .methods import Method


def ask(method: Method, case: Case, seed: int) -> dict[str, Any]:
    """Let a method answer; of the case it gets what was measured and nothing else."""
    return method.answer(Measurements(case.simulator, case.X, case.y), seed)


def result(method: Method, case: Case, seed: int) -> dict[str, Any]:
    """Return the judged answer: one row of the comparison.

    Every prediction out of range is measured against one and the same: the simulation as it is,
    its parameters fitted by least squares.
    """
    start = time.perf_counter()
    found = ask(method, case, seed)
    seconds = time.perf_counter() - start
    plain = calibrate(Measurements(case.simulator, case.X, case.y), seed)
    with np.errstate(all="ignore"):
        # a formula may go wherever it likes out of range; that shows in the ratio
        row = judge(case, found | {"predict_none": plain.predict}, seconds)
    effect = found.get("effect")
    if effect is not None and effect.kind not in KINDS:
        row["equivalent"] = draws_the_truth(case, effect)
    return row | {"ratio": float(np.nan_to_num(row["ratio"], nan=np.inf))}


def draws_the_truth(case: Case, effect: Cause) -> bool:
    """Tell whether a cause that the engineer has no word for draws the curve of a case.

    The rule is that of `same_curve`: fitted to the noise-free truth, beside the parameters, it
    leaves less than 5 % of what the parameters leave alone. What is no added curve does not count.
    """
    if effect.touches_simulation or not effect.coefficients or case.truth["kind"] == "none":
        return False
    simulator, p = case.simulator, len(case.simulator.input_names)
    # recorded columns without a name are called by their number
    names = (*simulator.input_names, *(f"x{k}" for k in range(p, case.X.shape[1])))
    measured = dict(zip(names, case.X.T, strict=True))
    effect = effect.prepare(Context(measured, p, simulator.parameters, simulator.assumed, 1.0))
    priors = list(effect.parameters.values())
    bounds = np.array([prior.ppf([1e-4, 1 - 1e-4]) for prior in priors]).reshape(-1, 2)
    starts = np.empty((1, 0))
    if priors:
        shares = qmc.Sobol(len(priors), rng=np.random.default_rng(0)).random(64)
        starts = np.column_stack([prior.ppf(u) for prior, u in zip(priors, shares.T, strict=True)])

    def columns(X: Array, shape: Array) -> Array:
        rows = dict(zip(names, np.tile(X, (len(shape), 1)).T, strict=True))
        theta = dict(zip(effect.parameters, np.repeat(shape, len(X), axis=0).T, strict=True))
        return effect.columns(rows, theta).reshape(len(shape), len(X), -1)

    form = Form(effect.kind, "", 1, bounds, starts, columns)
    problem = pose(simulator, case.X, case.truth["mu"], np.random.default_rng(0))
    fit = fit_form(problem, form, fit_plain(problem))
    return bool(np.sqrt(fit.rss / len(case.X)) < SAME_CURVE * rms(case.truth["left"]))
