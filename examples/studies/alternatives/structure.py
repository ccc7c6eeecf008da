"""Gaussian-process structure search: which kernel do the residuals follow?

After Duvenaud and others (2013), "Structure discovery in nonparametric regression through
compositional kernel search": base kernels over each column, hyperparameters by marginal likelihood,
the kernel by BIC. One effect is hidden, so one kernel is looked for, beside the noise and a kernel
for what the simulation's parameters can follow.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from hidden_effects.simulations import Array
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import (
    RBF,
    ConstantKernel,
    DotProduct,
    ExpSineSquared,
    Kernel,
    WhiteKernel,
)

from .calibration import Measurements, calibrate, with_term
from .features import features
from .kernel_over import Over

# there is no word for a step in kernels that come with scikit-learn, and no column in which a
# changed constant or a drifting parameter would be linear
WORDS = ("offset", "trend", "periodic", "bump", "gain", "missing-input")
_NOISE = WhiteKernel(0.5, (1e-4, 1e1))
# of the parameters, in noise standard deviations: they are as good as free
_FREE = ConstantKernel(1e4, "fixed")
_SIZES = (1e-3, 1e3)
# in shares of the measured span
_PERIODS = np.geomspace(0.12, 1.25, 14)
_LENGTHS = np.geomspace(0.03, 2.0, 8)
_LONGEST_BUMP = 0.25
_DESCENTS = 2


class _Candidate(NamedTuple):
    kind: str
    kernels: list[Kernel]  # the same one with different hyperparameters to start from


def diagnose(measured: Measurements, seed: int) -> dict[str, Any]:
    """Name the kernel with the smallest BIC."""
    calibrated = calibrate(measured, seed)
    columns = features(calibrated)
    described = columns(measured.X)
    n, n_columns = described.shape
    followed = np.sqrt(n) * calibrated.followed
    X, scale = np.column_stack([described, followed]), calibrated.residual.std()
    residual = calibrated.residual / scale
    around = _around(tuple(range(n_columns, X.shape[1])))
    found = [
        (kind, _fit([kernel + around for kernel in kernels], X, residual))
        for kind, kernels in _candidates(columns.words)
    ]
    kind, process = min(found, key=lambda one: _bic(one[1]))
    # the same price for the search as the engineer pays
    if _bic(process) + 2 * np.log(len(found)) > _bic(_fit([around], X, residual)):
        return {"kind": "none", "predict": calibrated.predict}
    effect = process.kernel_.k1
    if kind == "bump" and effect.kernel.k2.length_scale > _LONGEST_BUMP:
        kind = "unexplained"  # a smooth curve of no particular form

    def mean(new: Array) -> Array:
        return scale * effect(columns(new), X) @ process.alpha_[:, None]

    return {"kind": kind, "predict": with_term(calibrated, mean)}


def _around(followed: tuple[int, ...]) -> Kernel:
    """Return the kernel of what is there without an effect: parameters and noise."""
    return Over(_FREE * DotProduct(0.0, "fixed"), followed) + _NOISE


def _candidates(words: tuple[str, ...]) -> Iterator[_Candidate]:
    size = ConstantKernel(1.0, _SIZES)
    yield _Candidate("offset", [Over(size, (0,))])
    for j, word in enumerate(words):
        if word != "trend":
            # where the column is 0, so is the effect
            yield _Candidate(word, [Over(size * DotProduct(0.0, "fixed"), (j,))])
            continue
        yield _Candidate(word, [Over(size * DotProduct(1.0, (1e-2, 1e2)), (j,))])
        waves = [ExpSineSquared(1.0, p, (0.3, 1e2), (0.1, 1.3)) for p in _PERIODS]
        yield _Candidate("periodic", [Over(size * wave, (j,)) for wave in waves])
        smooth = [RBF(length, (0.02, 3.0)) for length in _LENGTHS]
        yield _Candidate("bump", [Over(size * kernel, (j,)) for kernel in smooth])


def _fit(kernels: list[Kernel], X: Array, residual: Array) -> GaussianProcessRegressor:
    """Maximise the marginal likelihood, from the best of the starts."""
    reached = [GaussianProcessRegressor(kernel, optimizer=None) for kernel in kernels]
    for process in reached:
        process.fit(X, residual)
    reached.sort(key=lambda process: -process.log_marginal_likelihood_value_)
    with warnings.catch_warnings():
        # a hyperparameter at its bound is an answer: no noise, or no effect
        warnings.simplefilter("ignore", ConvergenceWarning)
        fitted = [
            GaussianProcessRegressor(process.kernel).fit(X, residual)
            for process in reached[:_DESCENTS]
        ]
    return max(fitted, key=lambda process: process.log_marginal_likelihood_value_)


def _bic(process: GaussianProcessRegressor) -> float:
    n_numbers = len(process.kernel_.theta)
    return n_numbers * np.log(len(process.X_train_)) - 2 * process.log_marginal_likelihood_value_
