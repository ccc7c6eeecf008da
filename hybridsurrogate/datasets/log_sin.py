"""A logarithmic simulation of a process that also oscillates."""

from __future__ import annotations

from typing import Any

import numpy as np
from sklearn.utils import Bunch

from hybridsurrogate.arguments import random_generator
from hybridsurrogate.priors import truncated_normal
from hybridsurrogate.simulation.simulator import Simulator
from hybridsurrogate.types import FloatArray

_SIMULATED_RANGE = (1.0, 200.0)
_TRUE_OMEGA = 1.0
# inputs of the second test set, beyond those that are measured by default
_OUTSIDE = (100.0, 200.0)


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
    x = {
        "": np.linspace(*train_range, n_measured),
        "_in": rng.uniform(*train_range, n_test),
        "_out": rng.uniform(*_OUTSIDE, n_test),
    }
    mu = {word: _process(x[word]) for word in x}
    y = {word: mu[word] + noise * rng.standard_normal(len(mu[word])) for word in x}
    simulator = Simulator(
        logarithmic_growth,
        inputs={"x": _SIMULATED_RANGE},
        parameters={"omega": truncated_normal(0.9, 0.05, 0.6, 1.4)},
    )
    return Bunch(
        simulator=simulator,
        # last, as how many random numbers a design takes depends on the version of scipy
        simulation=simulator.run(n_runs, random_state=rng, ends=0),
        X=x[""][:, None],
        y=y[""],
        X_in=x["_in"][:, None],
        mu_in=mu["_in"],
        y_in=y["_in"],
        X_out=x["_out"][:, None],
        mu_out=mu["_out"],
        y_out=y["_out"],
        DESCR=(
            "y = 0.01 x + 1 + log(x) + sin(0.05 x) and normal noise, against a simulation "
            "0.01 x + 1 + omega log(x). First case study of arXiv:2412.11875.\n"
            "Source: generated.\n"
            "Licence: none needed.\n"
            "Units: none."
        ),
    )


def _process(x: FloatArray) -> FloatArray:
    return logarithmic_growth(x, np.full_like(x, _TRUE_OMEGA)) + np.sin(0.05 * x)
