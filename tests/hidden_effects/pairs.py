"""Two effects at once, each of the same size on its own."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .cases import Case, InfeasibleError, draw_setting, feasible, left_over, rms
from .curves import Setting, draw_effect, run
from .simulations import SIMULATIONS, Array

# The second is always a curve that is added, which can be made as large as the first. Pairs of
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
PAIR_NAMES = tuple("+".join(pair) for pair in PAIRS)

_MOST_REDRAWS = 200
# two curves of opposite sign may leave next to nothing together
_LEAST_TOGETHER = 1.0
# far from the other streams of random numbers, which begin with the position of a kind
_STREAM = 1000


def _together(
    setting: Setting,
    one_at: Callable[[Array], Array],
    other_at: Callable[[Array], Array],
    factor: float,
) -> Callable[[Array], Array]:
    return lambda X: one_at(X) + factor * (other_at(X) - run(setting, X))


def make_pair(name: str, size: float, seed: int, n_rows: int = 80) -> Case:
    """Make one data set with two hidden effects.

    Parameters
    ----------
    name : str
        One of ``PAIR_NAMES``, such as "trend+periodic".
    size : float
        Of each effect alone, after what the parameters absorb, in noise standard deviations.
    seed : int
    n_rows : int

    Returns
    -------
    Case
        ``truth`` holds kind (the name), kinds, noise_sd, parameters, mu and left.

    Raises
    ------
    InfeasibleError
        If no draw is admissible.
    """
    first, second = PAIRS[PAIR_NAMES.index(name)]
    rng = np.random.default_rng([_STREAM + PAIR_NAMES.index(name), seed])
    for _ in range(_MOST_REDRAWS):
        setting = draw_setting(SIMULATIONS[str(rng.choice(list(SIMULATIONS)))], n_rows, rng)
        effects = draw_effect(first, setting, rng), draw_effect(second, setting, rng)
        if effects[0] is None or effects[1] is None:
            continue
        one_at, other_at = effects[0][0], effects[1][0]
        base, one, other = run(setting, setting.X), one_at(setting.X), other_at(setting.X)
        left_one = left_over(setting.simulator, setting.X, one)
        noise_sd = rms(left_one) / size
        if not feasible(noise_sd, left_one, one - base, setting):
            continue
        factor = 1.0
        # what the parameters leave is nearly proportional to the curve: a few rounds suffice
        for _ in range(4):
            mu = base + factor * (other - base)
            factor *= rms(left_one) / max(rms(left_over(setting.simulator, setting.X, mu)), 1e-300)
        left_other = left_over(setting.simulator, setting.X, base + factor * (other - base))
        if abs(rms(left_other) / rms(left_one) - 1) > 0.05:
            continue
        if not feasible(noise_sd, left_other, factor * (other - base), setting):
            continue
        truth_at = _together(setting, one_at, other_at, factor)
        mu = truth_at(setting.X)
        left = left_over(setting.simulator, setting.X, mu)
        if rms(left) < _LEAST_TOGETHER * rms(left_one):
            continue
        names = setting.simulator.parameter_names
        truth = {
            "kind": name,
            "form": name,
            "kinds": (first, second),
            "noise_sd": noise_sd,
            "parameters": dict(zip(names, setting.omega, strict=False)),
            "mu": mu,
            "left": left,
        }
        y = mu + noise_sd * rng.normal(size=n_rows)
        return Case(setting.simulator, setting.X, y, setting.X_out, truth_at(setting.X_out), truth)
    raise InfeasibleError(f"{name!r} at size {size}")
