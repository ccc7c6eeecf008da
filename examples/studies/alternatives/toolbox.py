"""A statistician's toolbox: one test of the residuals for each explanation.

Every test asks whether a curve explains more of the residuals than chance would, beside what the
parameters can follow: the t-test for a shift, regression for a line, a factor or a recorded column,
the periodogram, the largest F statistic over all change points, a matched filter for a bump, and
for a constant or a drifting parameter the score test, whose curve is the simulation's sensitivity.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from hidden_effects.descent import slopes
from hidden_effects.fits import fit_form
from hidden_effects.forms import KINDS, Form, forms
from hidden_effects.problem import predict
from hidden_effects.simulations import Array
from scipy import stats

from .calibration import Calibrated, Measurements, calibrate

WORDS = KINDS
_LEVEL = 0.05
_REPLICATES = 300


def diagnose(measured: Measurements, seed: int) -> dict[str, Any]:
    """Name the curve with the smallest p-value; none, where Bonferroni's is above 5 %."""
    calibrated = calibrate(measured, seed)
    rng = np.random.default_rng(seed)
    noise = calibrated.beside(rng.normal(size=(len(measured.y), _REPLICATES)))
    tried = forms(measured.simulator, measured.X)
    logs = [_log_p_value(calibrated, _curves(calibrated, form), noise) for form in tried]
    best = int(np.argmin(logs))
    if logs[best] + np.log(len(tried)) > np.log(_LEVEL):
        return {"kind": "none", "target": "", "predict": calibrated.predict}
    fit = fit_form(calibrated.problem, tried[best], calibrated.fit)
    return {
        "kind": tried[best].kind,
        "target": tried[best].target,
        "predict": lambda X: predict(measured.simulator, fit, X),
    }


def _curves(calibrated: Calibrated, form: Form) -> Array:
    """Return the curves that the test looks for, (shapes, n, q)."""
    if form.kind == "gain":
        return calibrated.output[None, :, None]
    if form.columns is not None:
        return form.columns(calibrated.problem.X, form.starts)
    # the sensitivity to the one number of the form, where it changes nothing
    n_parameters = len(calibrated.fit.numbers)
    simulator = calibrated.problem.simulator
    nothing = simulator.assumed[form.target].value if form.kind == "wrong-constant" else 0.0
    numbers = np.append(calibrated.fit.numbers, nothing)
    moves = slopes(calibrated.problem, form, numbers[None])
    return moves[..., [n_parameters]]


def _log_p_value(calibrated: Calibrated, curves: Array, noise: Array) -> float:
    """Return the logarithm of the p-value of the best of some curves.

    Curves are looked at in the thousands and resemble each other. How many independent looks that
    amounts to is taken from noise: the smallest of K p-values has -log(1 - p) of mean 1 / K.
    """
    beside = calibrated.beside(curves)
    sizes = np.linalg.norm(curves, axis=1, keepdims=True)
    basis, strengths, _ = np.linalg.svd(beside / sizes, full_matrices=False)
    # what the parameters follow entirely cannot be tested
    basis = basis * (strengths > 1e-3)[:, None, :]
    q = basis.shape[2]
    free = len(calibrated.residual) - calibrated.followed.shape[1] - q

    def smallest(residuals: Array) -> Array:
        explained = (np.einsum("snq,nr->sqr", basis, residuals) ** 2).sum(axis=1).max(axis=0)
        left = np.maximum((residuals**2).sum(axis=0) - explained, 1e-300)
        return stats.f.logsf(explained / q / (left / free), q, free)

    log_p = float(smallest(calibrated.beside(calibrated.residual[:, None]))[0])
    if len(curves) == 1:
        return log_p
    looks = max(1.0, 1 / np.mean(-np.log1p(-np.exp(smallest(noise)))))
    return min(0.0, log_p + np.log(looks))
