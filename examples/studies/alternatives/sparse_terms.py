"""PySINDy's sparse regression of the residuals on a library of terms.

It is made for the terms of a differential equation, but a library and a thresholded least squares
serve for residuals over inputs as well. Once as it comes; once with a library that has waves, what
the parameters follow removed from terms and residuals, and the threshold chosen by extended BIC.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
from hidden_effects.simulations import Array

from .calibration import Calibrated, Curve, Measurements, calibrate, with_term
from .features import Features, features

# steps and bumps at unknown places would be more terms than rows; a changed constant or a drifting
# parameter is no term at all; the simulation's output is left out: among the terms, it was kept for
# all of the three trends looked at while this was written
WORDS = ("offset", "trend", "periodic", "missing-input")
WORDS_BY_DEFAULT = ("offset", "trend", "missing-input")
_N_FREQUENCIES = 8
_N_THRESHOLDS = 30


def diagnose(measured: Measurements, seed: int) -> dict[str, Any]:
    """Name the largest group of the terms that the best threshold keeps."""
    from pysindy import STLSQ

    calibrated = calibrate(measured, seed)
    columns = features(calibrated)
    terms, words = _library(columns)
    drawn = calibrated.beside(terms(measured.X))
    # terms that the parameters follow are gone, the others count alike
    sizes = np.linalg.norm(drawn, axis=0)
    usable = np.flatnonzero(sizes > 1e-3 * np.linalg.norm(terms(measured.X), axis=0))
    target = calibrated.residual
    kept, least = np.array([], dtype=int), _bic(target, 0, len(words))
    for threshold in np.geomspace(0.05, 1.0, _N_THRESHOLDS) * np.linalg.norm(target):
        optimizer = STLSQ(threshold=threshold, alpha=0.01)
        with warnings.catch_warnings():
            # that nothing is left above the largest threshold is an answer
            warnings.simplefilter("ignore")
            optimizer.fit(drawn[:, usable] / sizes[usable], target[:, None])
        chosen = usable[np.flatnonzero(optimizer.coef_[0])]
        left = target - drawn[:, chosen] @ np.linalg.lstsq(drawn[:, chosen], target)[0]
        bic = _bic(left, len(chosen), len(words))
        if bic < least:
            kept, least = chosen, bic
    return _answer(calibrated, terms, words, kept)


def diagnose_by_default(measured: Measurements, seed: int) -> dict[str, Any]:
    """Name the largest group of the terms that ``SINDy()`` finds: parabolas, threshold 0.1."""
    from pysindy import SINDy

    calibrated = calibrate(measured, seed)
    columns = features(calibrated)
    model = SINDy()
    recorded = slice(0, measured.X.shape[1])
    scaled = calibrated.residual / calibrated.residual.std()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model.fit(columns(measured.X)[:, recorded], t=1.0, x_dot=scaled[:, None])
    library = model.feature_library

    def terms(X: Array) -> Array:
        return np.asarray(library.transform(columns(X)[:, recorded]))

    kept = np.flatnonzero(model.coefficients()[0])
    words = [_word(row, columns.words) for row in library.powers_]
    return _answer(calibrated, terms, words, kept)


def _word(powers: Array, words: Sequence[str]) -> str:
    """Return what a monomial would be called."""
    involved = np.flatnonzero(powers)
    if len(involved) == 0:
        return "offset"
    return words[involved[0]] if len(involved) == 1 else "interaction"


def _library(columns: Features) -> tuple[Curve, list[str]]:
    """Return the terms as a function of X, and the word of each."""
    from pysindy import FourierLibrary

    inputs = [j for j, word in enumerate(columns.words) if word == "trend"]
    others = [j for j, word in enumerate(columns.words) if word == "missing-input"]
    waves = FourierLibrary(n_frequencies=_N_FREQUENCIES)

    def terms(X: Array) -> Array:
        scaled = columns(X)
        drawn = [np.ones((len(X), 1)), scaled[:, others]]
        for j in inputs:
            x = scaled[:, [j]]
            drawn += [x, x**2, np.asarray(waves.fit_transform(2 * np.pi * x))]
        return np.column_stack(drawn)

    words = ["offset", *(columns.words[j] for j in others)]
    for _ in inputs:
        words += ["trend", "trend", *["periodic"] * (2 * _N_FREQUENCIES)]
    return terms, words


def _bic(left: Array, n_kept: int, n_terms: int) -> float:
    """Return the BIC with the price of the search (Chen and Chen 2008, Biometrika 95:3)."""
    n = len(left)
    return n * np.log(np.mean(left**2) + 1e-300) + n_kept * (np.log(n) + 2 * np.log(n_terms))


def _answer(
    calibrated: Calibrated, terms: Curve, words: Sequence[str], kept: Array
) -> dict[str, Any]:
    if len(kept) == 0:
        return {"kind": "none", "predict": calibrated.predict}
    drawn = calibrated.beside(terms(calibrated.problem.X)[:, kept])
    weights = np.linalg.lstsq(drawn, calibrated.residual)[0]
    groups: dict[str, Array] = {}
    for term, weight, k in zip(drawn.T, weights, kept, strict=True):
        groups[words[k]] = groups.get(words[k], 0.0) + weight * term
    kind = max(groups, key=lambda word: float(np.linalg.norm(groups[word])))
    return {"kind": kind, "predict": with_term(calibrated, lambda X: terms(X)[:, kept])}
