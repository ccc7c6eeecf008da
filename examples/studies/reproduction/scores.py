"""Scores of both schemes over beta, and what the posteriors say, as one tidy table."""

from __future__ import annotations

import copy
import warnings
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy.stats import halfnorm

import hybridsurrogate as hs
from hybridsurrogate.scoring import pit

from .cases import CASES, CaseStudy, Rows

BETAS = np.round(np.linspace(0, 1, 21), 2)
POWER, MIXED, KENNEDY = "power scaling", "predictive weighting", "Kennedy-O'Hagan"
# shares of the rows in range: the authors draw 83 of them and 17 beyond for the last set
SHARES = {"in": 1.0, "out": 0.0, "1/1": 0.5, "5/1": 0.83}
COLUMNS = ["case", "seed", "scheme", "beta", "rows", "score", "value"]
LEVEL = 0.9


class Pointwise(NamedTuple):
    """Scores of each test row, as values that a mixture of predictions averages."""

    density: np.ndarray
    square: np.ndarray
    below: np.ndarray

    def mixed(self, other: Pointwise, beta: float) -> Pointwise:
        """Return the scores of the mixture with weight ``beta`` on these."""
        pairs = zip(self, other, strict=True)
        return Pointwise(*(beta * mine + (1 - beta) * theirs for mine, theirs in pairs))


def pointwise(model: Any, case: CaseStudy) -> Pointwise:
    """Return density, mean squared error of the mean, and share of predictions below, by row."""
    tests = case.tests.values()
    X, y, truth = (
        np.concatenate([getattr(rows, name) for rows in tests]) for name in Rows.__annotations__
    )
    density = np.exp(model.log_predictive_density(X, y))
    square = np.mean((model.sample_predictive_mean(X) - truth) ** 2, axis=0)
    draws = model.sample_posterior_predictive(X, random_state=0)
    return Pointwise(density, square, pit(draws, y, random_state=0))


def of_rows(case: CaseStudy, told: Pointwise) -> Iterable[tuple[str, str, float]]:
    """Yield test set, name of the score, and score."""
    inside = (told.below > (1 - LEVEL) / 2) & (told.below < (1 + LEVEL) / 2)
    by_row = {"ELPD": np.log(told.density), "RMSE": np.sqrt(told.square), "coverage": inside}
    ends = np.cumsum([len(rows.y) for rows in case.tests.values()])
    for score, values in by_row.items():
        parts = np.split(values, ends[:-1])
        means = {name: part.mean() for name, part in zip(case.tests, parts, strict=True)}
        for rows, share in SHARES.items():
            if len(means) == 2:
                yield rows, score, share * means["in"] + (1 - share) * means["out"]
            elif rows in means:
                yield rows, score, means[rows]


def of_posterior(posterior: Any, names: Sequence[str]) -> Iterable[tuple[str, str, float]]:
    """Yield mean and standard deviation of parameters and noise."""
    draws = dict(zip(names, posterior.values.T, strict=False)) | {"sigma": posterior.sigma}
    for name, values in draws.items():
        yield "posterior", f"{name} mean", float(values.mean())
        yield "posterior", f"{name} sd", float(values.std())


def scan(
    name: str, seed: int, betas: Sequence[float] = BETAS, n_draws: int = 1000, **settings: Any
) -> pd.DataFrame:
    """Return the tidy table of one data set of a case study, both schemes at every beta."""
    case = CASES[name](seed)
    common = {"n_draws": n_draws, "random_state": seed, **settings}
    found: list[tuple[str, float, tuple[str, str, float]]] = []
    with warnings.catch_warnings():
        # the ends of the scan strain the samplers, and rows out of range are the point of it
        warnings.simplefilter("ignore", hs.HybridSurrogateWarning)
        path = hs.beta_path(
            case.estimator(hs.PowerScaledSurrogate, **common), case.X, case.y, betas
        )
        mixed = case.estimator(hs.PredictiveWeightedSurrogate, **common).fit(case.X, case.y)
        for beta, model in zip(map(float, betas), path.estimators, strict=True):
            found += [(POWER, beta, row) for row in of_rows(case, pointwise(model, case))]
            posterior = of_posterior(model.posterior_, case.simulation.parameter_names)
            found += [(POWER, beta, row) for row in posterior]
        ends = [pointwise(at_weight(mixed, end), case) for end in (1.0, 0.0)]
        for beta in map(float, betas):
            found += [(MIXED, beta, row) for row in of_rows(case, ends[0].mixed(ends[1], beta))]
    return table(name, seed, found)


def at_weight(mixed: Any, beta: float) -> Any:
    """Return a fitted `PredictiveWeightedSurrogate` with its two posteriors mixed otherwise."""
    out = copy.copy(mixed)
    out.beta_ = beta
    return out


def kennedy_ohagan(name: str, seed: int, n_draws: int = 1000) -> pd.DataFrame:
    """Return the scores of Kennedy and O'Hagan's calibration in the same form."""
    case = CASES[name](seed)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", hs.HybridSurrogateWarning)
        model = case.estimator(
            hs.KennedyOHaganSurrogate,
            amplitude_prior=halfnorm(scale=1),
            n_draws=n_draws,
            random_state=seed,
        )
        told = pointwise(model.fit(case.X, case.y), case)
    return table(name, seed, [(KENNEDY, np.nan, row) for row in of_rows(case, told)])


def table(
    name: str, seed: int, found: Iterable[tuple[str, float, tuple[str, str, float]]]
) -> pd.DataFrame:
    """Return scores as rows."""
    rows = [(name, seed, scheme, beta, *row) for scheme, beta, row in found]
    return pd.DataFrame(rows, columns=COLUMNS)


def curves(frame: pd.DataFrame, case: str, scheme: str, rows: str, score: str) -> pd.DataFrame:
    """Return one score, a line for each seed and a column for each beta."""
    chosen = select(frame, case, scheme, rows, score)
    return chosen.pivot_table(index="seed", columns="beta", values="value")


def select(frame: pd.DataFrame, case: str, scheme: str, rows: str, score: str) -> pd.DataFrame:
    """Return the rows of one score; KeyError where there is none."""
    wanted = {"case": case, "scheme": scheme, "rows": rows, "score": score}
    chosen = frame[(frame[list(wanted)] == list(wanted.values())).all(axis=1)]
    if chosen.empty:
        raise KeyError(f"no {score} ({rows}) of {scheme} in case study {case}")
    return chosen
