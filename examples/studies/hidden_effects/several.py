"""Two or three effects at once, each of the same size on its own."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from .cases import Case, InfeasibleError, draw_setting, feasible, left_over, rms
from .curves import Setting, draw_effect, run
from .simulations import SIMULATIONS, Array

# All after the first are curves that are added, which can be made as large as the first. Pairs of
# which one holds the other, such as a trend and an offset, are no pairs.
PAIRS = (
    ("trend", "periodic"),
    ("trend", "step"),
    ("periodic", "step"),
    ("bump", "periodic"),
    ("gain", "periodic"),
    ("wrong-constant", "periodic"),
    ("trend", "missing-input"),
    ("step", "missing-input"),
    ("offset", "missing-input"),
    ("wrong-constant", "missing-input"),
    ("parameter-drift", "missing-input"),
    ("gain", "missing-input"),
)
TRIPLES = (
    ("trend", "periodic", "missing-input"),
    ("step", "periodic", "missing-input"),
    ("trend", "step", "missing-input"),
    ("offset", "periodic", "missing-input"),
    ("wrong-constant", "periodic", "missing-input"),
    ("wrong-constant", "step", "missing-input"),
    ("gain", "periodic", "missing-input"),
    ("parameter-drift", "periodic", "missing-input"),
)
PAIR_NAMES, TRIPLE_NAMES = (tuple(map("+".join, several)) for several in (PAIRS, TRIPLES))

_MOST_REDRAWS = 200
# curves of opposite sign may leave next to nothing together
_LEAST_TOGETHER = 1.0
# far from the other streams of random numbers, which begin with the position of a kind
_STREAMS = {name: 1000 + k for k, name in enumerate(PAIR_NAMES)}
_STREAMS |= {name: 2000 + k for k, name in enumerate(TRIPLE_NAMES)}


def _together(
    setting: Setting, curves: Sequence[Callable[[Array], Array]], factors: Sequence[float]
) -> Callable[[Array], Array]:
    def truth_at(X: Array) -> Array:
        base = run(setting, X)
        added = zip(curves[1:], factors, strict=True)
        return curves[0](X) + sum(factor * (curve(X) - base) for curve, factor in added)

    return truth_at


def _factor_of(setting: Setting, curve: Callable[[Array], Array], left_first: Array) -> float:
    """Return the factor with which a curve leaves as much as the first, NaN if none is found."""
    base = run(setting, setting.X)
    added = curve(setting.X) - base

    def left(factor: float) -> float:
        return rms(left_over(setting.simulator, setting.X, base + factor * added))

    factor = 1.0
    # what the parameters leave is nearly proportional to the curve: a few rounds suffice
    for _ in range(4):
        factor *= rms(left_first) / max(left(factor), 1e-300)
    return factor if abs(left(factor) / rms(left_first) - 1) <= 0.05 else float("nan")


def make_several(name: str, size: float, seed: int, n_rows: int = 80, smaller: float = 1.0) -> Case:
    """Make one data set with two or three hidden effects.

    Parameters
    ----------
    name : str
        One of ``PAIR_NAMES`` and ``TRIPLE_NAMES``, such as "trend+periodic".
    size : float
        Of each effect alone, after what the parameters absorb, in noise standard deviations.
    seed : int
    n_rows : int
    smaller : float, default=1.0
        Size of each effect after the first, in shares of the first.

    Returns
    -------
    Case
        ``truth`` holds kind (the name), kinds, noise_sd, parameters, mu and left.

    Raises
    ------
    InfeasibleError
        If no draw is admissible.
    """
    kinds = name.split("+")
    rng = np.random.default_rng([_STREAMS[name], seed])
    for _ in range(_MOST_REDRAWS):
        setting = draw_setting(SIMULATIONS[str(rng.choice(list(SIMULATIONS)))], n_rows, rng)
        effects = [draw_effect(kind, setting, rng) for kind in kinds]
        curves = [effect[0] for effect in effects if effect is not None]
        if len(curves) < len(kinds):
            continue
        base, one = run(setting, setting.X), curves[0](setting.X)
        left_one = left_over(setting.simulator, setting.X, one)
        noise_sd = rms(left_one) / size
        if not feasible(noise_sd, left_one, one - base, setting):
            continue
        factors = [_factor_of(setting, curve, left_one) for curve in curves[1:]]
        added = [
            f * (curve(setting.X) - base) for f, curve in zip(factors, curves[1:], strict=True)
        ]
        factors = [smaller * factor for factor in factors]
        if not all(
            np.isfinite(f)
            and feasible(noise_sd, left_over(setting.simulator, setting.X, base + a), a, setting)
            for f, a in zip(factors, added, strict=True)
        ):
            continue
        truth_at = _together(setting, curves, factors)
        mu = truth_at(setting.X)
        left = left_over(setting.simulator, setting.X, mu)
        if rms(left) < _LEAST_TOGETHER * rms(left_one):
            continue
        names = setting.simulator.parameter_names
        truth = {
            "kind": name,
            "form": name,
            "kinds": tuple(kinds),
            "noise_sd": noise_sd,
            "parameters": dict(zip(names, setting.omega, strict=False)),
            "mu": mu,
            "left": left,
        }
        y = mu + noise_sd * rng.normal(size=n_rows)
        return Case(setting.simulator, setting.X, y, setting.X_out, truth_at(setting.X_out), truth)
    raise InfeasibleError(f"{name!r} at size {size}")
