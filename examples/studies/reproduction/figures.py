"""The figures of the paper, from the scores of all seeds and from fits to the first data set."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

import hybridsurrogate as hs
from hybridsurrogate.numerics.atomic_file import written_whole
from hybridsurrogate.plotting import (
    Scene,
    new_axes,
    plot_bands_over_beta,
    plot_densities_over_beta,
    plot_mean_draws_over_beta,
    plot_scores_over_beta,
    plot_setup,
)

from .cases import CASES
from .claims import ROWS
from .extension import EXTENDED
from .scores import KENNEDY, MIXED, POWER, at_weight

# what the authors show
SHOWN = {
    "1": (0.0, 0.1, 0.4, 0.75, 1.0),
    "1.2": (0.0, 0.1, 0.4, 0.75, 1.0),
    "1 process": (0.0, 0.1, 0.5, 1.0),
    "2.1": (0.0, 0.1, 0.5, 1.0),
    "2.2": (0.0, 0.25, 0.5, 0.75, 1.0),
}
TITLES = {
    "1": "Case study 1",
    "1.2": "Case study 1.2",
    "30 runs": "30 runs, 30 measured rows",
    "50 runs": "50 runs, 30 measured rows",
    "1 process": "Case study 1 with a Gaussian process",
    "2.1": "Case study 2.1",
    "2.2": "Case study 2.2",
}
DENSITIES = (0.0, 0.1, 0.4, 0.5, 0.75, 1.0)
N_SHOWN = 400


class Picture(NamedTuple):
    """A written figure."""

    name: str
    title: str


def write(frame: pd.DataFrame, folder: Path) -> list[Picture]:
    """Write the figures of every case study in the table."""
    folder.mkdir(parents=True, exist_ok=True)
    made = []
    for case in [name for name in TITLES if (frame["case"] == name).any()]:
        stem = "case-" + case.replace(".", "-").replace(" ", "-")
        draws: dict[str, Callable[[], Figure]] = {
            "scores": lambda case=case: of_scores(frame, case)
        }
        if case in SHOWN:
            study = Study(case)
            draws |= {
                "setup": study.setup,
                "means": study.means,
                "bands": study.bands,
                "posteriors": study.posteriors,
            }
        for kind, draw in draws.items():
            figure = draw()
            with written_whole(folder / f"{stem}-{kind}.png") as part:
                figure.savefig(part, dpi=80)
            made.append(Picture(f"{stem}-{kind}", f"{TITLES[case]}: {kind}"))
    return made


def of_scores(frame: pd.DataFrame, case: str) -> Figure:
    """Return scores over beta, with the models that have none as level lines."""
    chosen = frame[(frame["case"] == case) & frame["score"].isin(["ELPD", "RMSE"])]
    keys = ["scheme", "rows", "beta", "seed"]
    # pivot_table drops missing keys: models without beta get one of their own
    wide = chosen.fillna({"beta": -1.0}).pivot_table(index=keys, columns="score", values="value")
    wide = wide.reset_index().rename(columns={"ELPD": "elpd", "RMSE": "rmse", "rows": "test"})
    order = [rows for rows in ("in", "out", "1/1", "5/1") if (wide["test"] == rows).any()]
    wide["test"] = pd.Categorical(wide["test"], order, ordered=True)
    wide = wide.sort_values(["test", "scheme"], ascending=[True, False])
    wide["test"] = wide["test"].astype(str).replace(ROWS)
    over = wide[wide["scheme"].isin([POWER, MIXED])]
    single = wide[wide["scheme"].isin([KENNEDY, EXTENDED])].rename(columns={"scheme": "model"})
    return plot_scores_over_beta(over, references=single if len(single) else None)[0, 0].figure


class Study:
    """Fits to the first data set of a case study, and the figures made of them."""

    def __init__(self, name: str, n_draws: int = N_SHOWN) -> None:
        self.case = case = CASES[name](0)
        self.betas = SHOWN[name]
        (self.xlabel,) = case.simulation.input_names
        low, high = case.simulation.input_ranges[self.xlabel]
        self.x = np.linspace(low, high, 120)[:, None]
        settings: dict[str, Any] = {"n_draws": n_draws, "random_state": 0}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", hs.HybridSurrogateWarning)
            every = sorted({*self.betas, *DENSITIES})
            self.path = {
                beta: case.estimator(hs.PowerScaledSurrogate, beta=beta, **settings).fit(
                    case.X, case.y
                )
                for beta in every
            }
            mixed = case.estimator(hs.PredictiveWeightedSurrogate, **settings).fit(case.X, case.y)
        self.mixed = mixed

    def scene(self) -> Scene:
        """Return what is measured, and the truth."""
        case = self.case
        X, truth = (
            np.concatenate([getattr(rows, key) for rows in case.tests.values()])
            for key in ("X", "truth")
        )
        order = np.argsort(X[:, 0])
        return Scene(
            measured=(case.X[:, 0], case.y),
            truth=(X[order, 0], truth[order]),
            train=(float(case.X.min()), float(case.X.max())),
            xlabel=self.xlabel,
            ylabel=case.simulation.output,
        )

    def setup(self) -> Figure:
        """Return runs and measurements."""
        runs = self.case.simulation
        name = runs.parameter_names[0]
        return plot_setup(
            self.scene(), runs.X[:, 0], runs.y, runs.omega[:, 0], omega_label=name
        ).figure

    def means(self) -> Figure:
        """Return draws of the mean, in the colour of the first parameter."""
        draws: dict[str, list[np.ndarray]] = {POWER: [], MIXED: []}
        omega: dict[str, list[np.ndarray]] = {POWER: [], MIXED: []}
        for beta in self.betas:
            model = self.path[beta]
            draws[POWER].append(model.sample_predictive_mean(self.x))
            omega[POWER].append(model.posterior_.values[:, 0])
            curves, values = parts(self.mixed, self.x, beta)
            draws[MIXED].append(curves)
            omega[MIXED].append(values)
        name = self.case.simulation.parameter_names[0]
        shown = plot_mean_draws_over_beta(
            self.x[:, 0], draws, omega, self.betas, scene=self.scene(), omega_label=name
        )
        return shown[0, 0].figure

    def bands(self) -> Figure:
        """Return posterior predictive bands."""
        draws = {
            POWER: [self.path[b].sample_posterior_predictive(self.x) for b in self.betas],
            MIXED: [
                at_weight(self.mixed, b).sample_posterior_predictive(self.x) for b in self.betas
            ],
        }
        shown = plot_bands_over_beta(self.x[:, 0], draws, self.betas, scene=self.scene())
        return shown[0, 0].figure

    def posteriors(self) -> Figure:
        """Return densities of the parameters and of the noise over beta."""
        case = self.case
        names = case.simulation.parameter_names
        axes = new_axes(1, len(names) + 1, width=3.4 * (len(names) + 1), height=4.4)
        for k, name in enumerate(names):
            values = [self.path[beta].posterior_.values[:, k] for beta in DENSITIES]
            prior, truth = case.simulation.parameters[name], case.truth.get(name)
            plot_densities_over_beta(DENSITIES, values, axes[k], prior, truth, label=name)
        sigma = [self.path[beta].posterior_.sigma for beta in DENSITIES]
        prior = case.settings["noise_prior"]
        plot_densities_over_beta(DENSITIES, sigma, axes[-1], prior, label="sigma")
        return axes[0].figure


def parts(mixed: Any, X: np.ndarray, beta: float) -> tuple[np.ndarray, np.ndarray]:
    """Return curves of a mixture and their omega, NaN for the surrogate that has none."""
    n_simulated = round(beta * N_SHOWN)
    curves, omega = [], []
    if n_simulated:
        curves.append(at_weight(mixed, 1.0).sample_predictive_mean(X)[:n_simulated])
        omega.append(mixed.simulation_posterior_.values[:n_simulated, 0])
    if n_simulated < N_SHOWN:
        rest = N_SHOWN - n_simulated
        curves.append(at_weight(mixed, 0.0).sample_predictive_mean(X)[:rest])
        omega.append(np.full(rest, np.nan))
    return np.concatenate(curves), np.concatenate(omega)
