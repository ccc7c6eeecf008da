"""An epidemic whose simulation assumes too slow a recovery."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import uniform
from sklearn.utils import Bunch

from hybridsurrogate.arguments import random_generator
from hybridsurrogate.datasets.log_sin import measured_and_test_inputs, measured_and_test_sets
from hybridsurrogate.priors import truncated_normal
from hybridsurrogate.simulation.simulator import Assumed, SimulationData, Simulator
from hybridsurrogate.types import FloatArray

# people in the boarding school of `make_sir`, and what the simulation assumes a day
_POPULATION = 763.0
_ASSUMED_RECOVERY_RATE = 0.55
# of the negative binomial counts
_PRECISION = 5.0
# exact to twelve digits for 14 days at 3 contacts a day, to eight for 20 days
_STEPS, _ORDER = 60, 12


def infected(t: ArrayLike, contact_rate: ArrayLike, recovery_rate: ArrayLike) -> FloatArray:
    """Return how many are infected at time t, one of 763 being infected at time zero.

    The SIR equations, with s and i the shares of the susceptible and of the infected,

        ds/dt = -contact_rate s i,    di/dt = contact_rate s i - recovery_rate i,

    are followed by Taylor series over steps of t / 60. As the equations are quadratic, each
    coefficient of a series follows from those before it [1]_.

    Parameters
    ----------
    t, contact_rate, recovery_rate : float or array-like
        Times, and rates per unit of time; of shapes that broadcast. What comes out for a row does
        not depend on the other rows.

    Returns
    -------
    ndarray of the common shape

    References
    ----------
    .. [1] À. Jorba, M. Zou, "A software package for the numerical integration of ODEs by means of
       high-order Taylor methods", Experimental Mathematics 14, 2005.

    Examples
    --------
    >>> from hybridsurrogate.datasets.sir import infected
    >>> infected([0.0, 7.0, 14.0], 1.6, 0.7).round(1)
    array([  1. , 147.4,  17.9])
    """
    step, contact, recovery = np.broadcast_arrays(
        *(np.asarray(values, dtype=float) for values in (t, contact_rate, recovery_rate))
    )
    step = step / _STEPS
    # rates per step, so that a step's end is the sum of the coefficients
    contact, recovery = step * contact, step * recovery
    s, i = np.empty((2, _ORDER + 1, *step.shape))
    s[0], i[0] = 1 - 1 / _POPULATION, 1 / _POPULATION
    for _ in range(_STEPS):
        for k in range(_ORDER):
            # coefficient k of the product s i
            met = contact * np.einsum("k...,k...->...", s[: k + 1], i[k::-1])
            s[k + 1] = -met / (k + 1)
            i[k + 1] = (met - recovery * i[k]) / (k + 1)
        s[0], i[0] = s.sum(axis=0), i.sum(axis=0)
    return _POPULATION * i[0]


@dataclass(frozen=True)
class ReportedInfected:
    """The number of infected as a health office would write it down.

    Parameters
    ----------
    add_one : bool
        Add one, so that there is a logarithm of no cases at all.
    round_counts : bool
        Round to whole numbers.

    Examples
    --------
    >>> from hybridsurrogate.datasets.sir import ReportedInfected
    >>> ReportedInfected(add_one=True, round_counts=True)([7.0], [1.6], [0.7])
    array([148.])
    """

    add_one: bool = True
    round_counts: bool = False

    def __call__(
        self,
        t: ArrayLike,
        contact_rate: ArrayLike,
        recovery_rate: ArrayLike = _ASSUMED_RECOVERY_RATE,
    ) -> FloatArray:
        """Run the epidemic."""
        number = infected(t, contact_rate, recovery_rate)
        return (np.round(number) if self.round_counts else number) + self.add_one


def make_sir(
    n_measured: int = 30,
    n_runs: int = 100,
    n_test: int = 100,
    train_range: tuple[float, float] = (1, 7.5),
    add_one: bool = True,
    round_counts: bool = False,
    random_state: Any = None,
) -> Bunch:
    """Make counts of the infected in an epidemic that the simulation takes to last longer.

    An infection spreads in a boarding school of 763 in which one is infected at time zero. The
    simulation assumes a recovery rate of 0.55 a day and leaves the contact rate unknown;
    in the epidemic that is measured they are 0.7 and 1.6. It is the second case
    study of [1]_.

    Parameters
    ----------
    n_measured : int
        Counts, at evenly spaced times over ``train_range``.
    n_runs : int
        Runs of each simulation, without noise, over times from 1 to 14 and contact rates from 1 to
        3; where the recovery rate is not fixed, over recovery rates from 0.3 to 0.9, too.
    n_test : int
        Rows of each test set.
    train_range : pair of float
        Measured times.
    add_one : bool
        Add one to all counts and to the simulated ones, as a log-normal likelihood needs;
        False for likelihoods of counts.
    round_counts : bool
        Round simulated counts to whole numbers; the runs of ``simulation_fixed`` up or down
        at random, as those of the case study.
    random_state : None, int, numpy Generator or RandomState

    Returns
    -------
    sklearn.utils.Bunch
        simulator : Simulator
            The simulation.
        simulation : SimulationData
            Its runs. The recovery rate is assumed to be 0.55, and varies over the runs: a
            diagnosis can find out that it is wrong.
        simulator_fixed : Simulator
            The simulation as published.
        simulation_fixed : SimulationData
            The recovery rate is 0.55 in all runs, as published. The simulator does not round.
        X, y : ndarray of shape (n_measured, 1) and (n_measured,)
            Measured inputs and outputs.
        X_in, mu_in, y_in : ndarray
            Test times, uniform over ``train_range``; the true output without and with noise.
        X_out, mu_out, y_out : ndarray
            The same for times from 7.5 to 14.
        DESCR : str
            A description.

    Notes
    -----
    Counts are negative binomial with precision 5: their variance is mu + mu^2 / 5, mu being the
    true number of infected.

    References
    ----------
    .. [1] P. Reiser, P.-C. Bürkner, A. Guthke, "Bayesian Surrogate Training on Multiple Data
       Sources: A Hybrid Modeling Strategy", arXiv:2412.11875, 2024.

    Examples
    --------
    >>> from hybridsurrogate.datasets import make_sir
    >>> data = make_sir(random_state=0)
    >>> data.X.shape, data.y.shape
    ((30, 1), (30,))
    >>> data.simulator([7.0], [1.6]).round(1)
    array([222.])
    """
    rng = random_generator(random_state)
    t = measured_and_test_inputs(train_range, (7.5, 14.0), n_measured, n_test, rng)
    number = {word: infected(t[word], contact_rate=1.6, recovery_rate=0.7) for word in t}
    share = {word: _PRECISION / (_PRECISION + number[word]) for word in t}
    y = {word: rng.negative_binomial(_PRECISION, share[word]).astype(float) + add_one for word in t}
    inputs = {"t": (1.0, 14.0)}
    unknown = {"contact_rate": truncated_normal(2.0, 0.5, 1, 3)}
    simulator = Simulator(
        ReportedInfected(add_one, round_counts),
        inputs=inputs,
        parameters=unknown,
        assumed={"recovery_rate": Assumed(_ASSUMED_RECOVERY_RATE, uniform(0.3, 0.6))},
        output="infected",
    )
    fixed = Simulator(ReportedInfected(add_one), inputs, unknown, output="infected")
    # last, as how many random numbers a design takes depends on the version of scipy
    simulation, simulation_fixed = (
        sim.run(n_runs, random_state=rng, ends=0) for sim in (simulator, fixed)
    )
    if round_counts:
        simulation_fixed = _rounded_at_random(simulation_fixed, rng)
    return Bunch(
        simulator=simulator,
        simulation=simulation,
        simulator_fixed=fixed,
        simulation_fixed=simulation_fixed,
        **measured_and_test_sets(t, {word: number[word] + add_one for word in t}, y),
        DESCR=(
            "Negative binomial counts of the infected in an SIR epidemic among 763 with contact "
            "rate 1.6 and recovery rate 0.7, against a simulation that assumes a recovery rate of "
            "0.55. Second case study of arXiv:2412.11875.\n"
            "Source: generated.\n"
            "Licence: none needed.\n"
            "Units: days, persons, rates per day."
        ),
    )


def _rounded_at_random(runs: SimulationData, rng: np.random.Generator) -> SimulationData:
    # up with the probability of the fraction, so that the mean stays
    y = np.floor(runs.y + rng.uniform(size=runs.n_rows))
    return SimulationData(
        runs.X,
        runs.omega,
        y,
        runs.input_ranges,
        runs.parameters,
        output=runs.output,
        simulator=runs.simulator,
    )
