"""The case studies: runs, measured data, test sets and the published settings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from scipy.stats import halfnorm, norm
from sklearn.utils import Bunch

import hybridsurrogate as hs
from hybridsurrogate.datasets import fetch_covid19_italy, make_log_sin, make_sir

N_TRAIN = 60
# the authors' code lets the measured rows of case study 1.2 reach 70 % of the simulated range
FURTHER = 1 + 0.7 * 199


@dataclass(frozen=True)
class Rows:
    """Test rows: inputs, what is measured there, and the output without noise."""

    X: np.ndarray
    y: np.ndarray
    truth: np.ndarray


@dataclass(frozen=True)
class CaseStudy:
    """One data set of a case study.

    ``simulation`` are the published runs, ``simulator`` the simulation that a diagnosis asks,
    ``settings`` what every estimator takes, ``truth`` the true parameters where they are known.
    """

    simulation: hs.SimulationData
    simulator: hs.Simulator
    X: np.ndarray
    y: np.ndarray
    tests: dict[str, Rows]
    settings: dict[str, Any]
    truth: dict[str, float] = field(default_factory=dict)

    def estimator(self, scheme: Callable[..., Any], **more: Any) -> Any:
        """Return an estimator of a scheme with the published settings."""
        return scheme(self.simulation, **{**self.settings, **more})


def published(degree: int = 5, **more: Any) -> dict[str, Any]:
    """Return the authors' surrogate and priors."""
    surrogate = hs.PolynomialChaos(degree, norm(0, 5))
    return {"surrogate": surrogate, "noise_prior": halfnorm(scale=0.5), **more}


def both_tests(data: Bunch, beyond: float) -> dict[str, Rows]:
    """Return the test sets in and out of the measured range, which ends at ``beyond``."""
    keys = ("X", "y", "mu")
    sets = {name: tuple(data[f"{key}_{name}"] for key in keys) for name in ("in", "out")}
    far = sets["out"][0][:, 0] >= beyond
    return {"in": Rows(*sets["in"]), "out": Rows(*(values[far] for values in sets["out"]))}


def log_sin(
    seed: int, n_runs: int = 100, end: float = 100.0, degree: int = 5, process: bool = False
) -> CaseStudy:
    """Case study 1: a logarithm that lacks an oscillation."""
    data = make_log_sin(n_runs=n_runs, train_range=(1, end), random_state=seed)
    settings = published(degree)
    if process:
        settings["surrogate"] = hs.GaussianProcess(amplitude_prior=halfnorm(scale=1))
    return CaseStudy(
        data.simulation,
        data.simulator,
        data.X,
        data.y,
        both_tests(data, end),
        settings,
        {"omega": 1.0},
    )


def epidemic(seed: int, n_runs: int = 100, end: float = 7.5) -> CaseStudy:
    """Case study 2.1: an epidemic whose simulation assumes too slow a recovery, in every run."""
    data = make_sir(n_runs=n_runs, round_counts=True, train_range=(1, end), random_state=seed)
    return CaseStudy(
        data.simulation_fixed,
        make_sir(random_state=seed).simulator,
        data.X,
        data.y,
        both_tests(data, 7.5),
        published(likelihood="lognormal"),
        {"contact_rate": 1.6},
    )


def italy(seed: int, n_runs: int = 1000) -> CaseStudy:
    """Case study 2.2: Italy's first wave; the seed is that of the runs, as the data are given."""
    data = fetch_covid19_italy(download_if_missing=False)
    t, y = data.data.to_numpy(), data.target.to_numpy()
    runs = data.simulator.run(n_runs, random_state=seed, ends=0)
    # the authors' code adds one to the runs and none to the data
    simulation = hs.SimulationData(
        runs.X, runs.omega, runs.y + 1, runs.input_ranges, runs.parameters, output=runs.output
    )
    return CaseStudy(
        simulation,
        data.simulator,
        t[:N_TRAIN],
        y[:N_TRAIN],
        # nobody knows the output without noise: the measured one stands in
        {"out": Rows(t[N_TRAIN:], y[N_TRAIN:], y[N_TRAIN:])},
        published(likelihood="lognormal"),
    )


CASES: dict[str, Callable[[int], CaseStudy]] = {
    "1": log_sin,
    # degree six as in the authors' settings
    "1.2": partial(log_sin, end=FURTHER, degree=6),
    "30 runs": partial(log_sin, n_runs=30),
    "50 runs": partial(log_sin, n_runs=50),
    "1 process": partial(log_sin, process=True),
    "2.1": epidemic,
    # not in the paper: counts over the whole epidemic; test rows out of range stay where they were
    "2.1 whole": partial(epidemic, end=14.0),
    "2.2": italy,
}
