"""gplearn's symbolic regression: formulas that are bred to follow the residuals.

A formula is judged by what it explains beside the parameters, with a factor of its own. Of all that
were bred the one with the best BIC counts, each node of a formula costing like a fitted number. The
search costs 2 ln(number of formulas), and a formula that does not beat no formula at all is none.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from hidden_effects.simulations import Array

from .calibration import Calibrated, Measurements, calibrate, with_term
from .features import features

# a changed constant or a drifting parameter is no formula of the columns
WORDS = ("offset", "trend", "periodic", "step", "bump", "gain", "missing-input")
# chosen for the time it takes, a few seconds a case; the library's own are 1000 and 20
_POPULATION = 300
_GENERATIONS = 6
# a simpler curve that leaves less of a formula, in shares of its sum of squares, gives it its name
_SAME = 0.05
_NAMES = {"sin": "periodic", "step": "step", "bell": "bump"}


def diagnose(measured: Measurements, seed: int) -> dict[str, Any]:
    """Name the formula with the best BIC."""
    from gplearn.fitness import make_fitness
    from gplearn.functions import make_function
    from gplearn.genetic import SymbolicRegressor

    calibrated = calibrate(measured, seed)
    columns = features(calibrated)
    X, target = columns(measured.X), calibrated.residual
    total, n = float(target @ target), len(target)

    def left(_: Array, curve: Array, __: Array) -> float:
        # the library tries the metric on two made-up rows before it starts
        return _share_left(calibrated, curve) if len(curve) == n else 1.0

    regressor = SymbolicRegressor(
        population_size=_POPULATION,
        generations=_GENERATIONS,
        function_set=(
            "add",
            "sub",
            "mul",
            "div",
            "sin",
            make_function(function=_step, name="step", arity=1),
            make_function(function=_bell, name="bell", arity=1),
        ),
        const_range=(-10.0, 10.0),
        init_depth=(1, 4),
        metric=make_fitness(function=left, greater_is_better=False),
        parsimony_coefficient=0.005,
        random_state=seed,
    )
    with np.errstate(all="ignore"):
        regressor.fit(X, target)
    bred = {p for generation in regressor._programs for p in generation if p is not None}
    cost = {p: n * np.log(p.raw_fitness_ * total / n) + p.length_ * np.log(n) for p in bred}
    best = min(cost, key=lambda p: (cost[p], str(p)))
    price = 2 * np.log(len({str(p) for p in bred}))
    if cost[best] + price >= n * np.log(total / n):
        return {"kind": "none", "predict": calibrated.predict}

    def formula(new: Array) -> Array:
        return best.execute(columns(new))[:, None]

    kind = _kind(calibrated, best.execute(X), X, str(best), columns.words)
    return {"kind": kind, "formula": str(best), "predict": with_term(calibrated, formula)}


def _step(x: Array) -> Array:
    return (x > 0).astype(float)


def _bell(x: Array) -> Array:
    return np.exp(-(np.clip(x, -20, 20) ** 2))


def _share_left(calibrated: Calibrated, curve: Array) -> float:
    """Return what a curve leaves of the sum of squares, its factor at its best."""
    if not np.isfinite(curve).all():
        return 1.0
    beside = calibrated.beside(curve[:, None])[:, 0]
    size = float(beside @ beside)
    if size <= 1e-10 * float(curve @ curve):
        return 1.0
    target = calibrated.residual
    return max(1 - float(beside @ target) ** 2 / size / float(target @ target), 1e-12)


def _kind(
    calibrated: Calibrated, curve: Array, X: Array, formula: str, words: tuple[str, ...]
) -> str:
    """Say what a formula is: what it does beside the parameters, or else its functions."""
    drawn = calibrated.beside(curve[:, None])[:, 0]

    def leaves(columns: Array) -> float:
        beside = calibrated.beside(columns)
        rest = drawn - beside @ np.linalg.lstsq(beside, drawn, rcond=1e-8)[0]
        return float(rest @ rest) / float(drawn @ drawn)

    constant = np.ones((len(X), 1))
    if leaves(constant) < _SAME:
        return "offset"
    left = [
        leaves(np.column_stack([constant, x]) if word == "trend" else x[:, None])
        for x, word in zip(X.T, words, strict=True)
    ]
    if min(left) < _SAME:
        return words[int(np.argmin(left))]
    named = [kind for function, kind in _NAMES.items() if f"{function}(" in formula]
    return named[0] if len(named) == 1 else "unexplained"
