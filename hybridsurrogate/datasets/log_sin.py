"""A logarithmic simulation of a process that also oscillates."""

from __future__ import annotations

from typing import Any

import numpy as np
from sklearn.utils import Bunch

from hybridsurrogate.arguments import random_generator
from hybridsurrogate.priors import truncated_normal
from hybridsurrogate.simulation.simulator import Simulator
from hybridsurrogate.types import FloatArray


def logarithmic_growth(x: FloatArray, omega: FloatArray) -> FloatArray:
    """Return the output of the simulation: 0.01 x + 1 + omega log(x)."""
    return 0.01 * x + 1 + omega * np.log(x)


def make_log_sin(
    n_measured: int = 30,
    n_runs: int = 100,
    n_test: int = 100,
    noise: float = 0.2,
    train_range: tuple[float, float] = (1, 100),
    random_state: Any = None,
) -> Bunch:
    """Make data from a process whose oscillation the simulation lacks.

    The simulation is 0.01 x + 1 + omega log(x). The process that is measured has omega = 1 and adds
    sin(0.05 x), whose period is 126. It is the first case study of [1]_.

    Parameters
    ----------
    n_measured : int
        Measurements, at evenly spaced inputs over ``train_range``.
    n_runs : int
        Runs of the simulation, without noise, over x from 1 to 200 and omega from 0.6 to 1.4.
    n_test : int
        Rows of each test set.
    noise : float
        Standard deviation of the measurements.
    train_range : pair of float
        Measured inputs.
    random_state : None, int, numpy Generator or RandomState

    Returns
    -------
    sklearn.utils.Bunch
        simulator : Simulator
            The simulation.
        simulation : SimulationData
            Its runs.
        X, y : ndarray of shape (n_measured, 1) and (n_measured,)
            Measured inputs and outputs.
        X_in, mu_in, y_in : ndarray
            Test inputs, uniform over ``train_range``; the true output without and with noise.
        X_out, mu_out, y_out : ndarray
            The same for inputs from 100 to 200.
        DESCR : str
            A description.

    References
    ----------
    .. [1] P. Reiser, P.-C. Bürkner, A. Guthke, "Bayesian Surrogate Training on Multiple Data
       Sources: A Hybrid Modeling Strategy", arXiv:2412.11875, 2024.

    Examples
    --------
    >>> from hybridsurrogate.datasets import make_log_sin
    >>> data = make_log_sin(random_state=0)
    >>> data.X.shape, data.y.shape
    ((30, 1), (30,))
    >>> data.simulation
    SimulationData(100 runs of logarithmic_growth: x -> y, parameters: omega)
    """
    rng = random_generator(random_state)
    x = measured_and_test_inputs(train_range, (100.0, 200.0), n_measured, n_test, rng)
    mu = {word: logarithmic_growth(x[word], np.ones(1)) + np.sin(0.05 * x[word]) for word in x}
    y = {word: mu[word] + noise * rng.standard_normal(len(mu[word])) for word in x}
    simulator = Simulator(
        logarithmic_growth,
        inputs={"x": (1.0, 200.0)},
        parameters={"omega": truncated_normal(0.9, 0.05, 0.6, 1.4)},
    )
    return Bunch(
        simulator=simulator,
        # last, as how many random numbers a design takes depends on the version of scipy
        simulation=simulator.run(n_runs, random_state=rng, ends=0),
        **measured_and_test_sets(x, mu, y),
        DESCR=(
            "y = 0.01 x + 1 + log(x) + sin(0.05 x) and normal noise, against a simulation "
            "0.01 x + 1 + omega log(x). First case study of arXiv:2412.11875.\n"
            "Source: generated.\n"
            "Licence: none needed.\n"
            "Units: none."
        ),
    )


def measured_and_test_inputs(
    train_range: tuple[float, float],
    outside: tuple[float, float],
    n_measured: int,
    n_test: int,
    rng: np.random.Generator,
) -> dict[str, FloatArray]:
    """Return measured inputs "", and those of test sets in this range, "_in", and outside, "_out".

    Parameters
    ----------
    train_range, outside : pair of float
    n_measured, n_test : int
    rng : numpy Generator
    """
    return {
        "": np.linspace(*train_range, n_measured),
        "_in": rng.uniform(*train_range, n_test),
        "_out": rng.uniform(*outside, n_test),
    }


def measured_and_test_sets(
    x: dict[str, FloatArray], mu: dict[str, FloatArray], y: dict[str, FloatArray]
) -> dict[str, FloatArray]:
    """Return X and y of what is measured, and X, mu and y of both test sets.

    Parameters
    ----------
    x, mu, y : dict of "", "_in" and "_out" to ndarray of shape (n,)
        Inputs, outputs without and with noise.
    """
    sets = {"X": x[""][:, None], "y": y[""]}
    for word in ("_in", "_out"):
        sets |= {f"X{word}": x[word][:, None], f"mu{word}": mu[word], f"y{word}": y[word]}
    return sets
