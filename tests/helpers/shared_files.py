"""Files that are shared between projects and not part of this repository."""

import json
import os
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.stats import norm, truncnorm

import hybridsurrogate as hs

_ROOT = Path(__file__).resolve().parents[2]
SHARED = Path(os.environ.get("HYBRIDSURROGATE_SHARED", _ROOT.parent / "shared"))

needs_reference = pytest.mark.skipif(
    not (SHARED / "reference" / "reference.json").exists(),
    reason=f"no reference posteriors in {SHARED}: set HYBRIDSURROGATE_SHARED",
)


def shared_path(*parts):
    """Path of a shared file; the test that asks is skipped where there is none."""
    path = SHARED.joinpath(*parts)
    if not path.exists():
        pytest.skip(f"{path} does not exist: set HYBRIDSURROGATE_SHARED")
    return path


def reference_values():
    """Everything in reference.json, or nothing where it is absent."""
    path = SHARED / "reference" / "reference.json"
    return json.loads(path.read_text()) if path.exists() else {}


class ReferenceCase:
    """One case study: its data as the package takes them, and its tables as they are."""

    def __init__(self, name):
        values = reference_values()
        self.name = name
        self.expected = values[name]
        self.order = values["conventions"]["poly_order"]
        settings = values["cases"][name]
        self.likelihood = settings["likelihood"].split(",")[0]
        self.x_range = tuple(settings["x_range"])
        self.omega_range = tuple(settings["omega_range"])
        # "Normal(mean, sd) truncated to [low, high]"
        self.omega_mean, self.omega_sd = (
            float(number) for number in settings["omega_prior"][7:].split(")")[0].split(",")
        )
        self.tables = {
            table: pd.read_csv(shared_path("reference", name, f"{table}.csv"))
            for table in ("sim", "real", "oos", "ood")
        }
        real = self.tables["real"]
        self.X, self.y = real[["x"]].to_numpy(), real["y"].to_numpy()
        runs = self.tables["sim"]
        self.simulation = hs.SimulationData(
            runs["x"],
            runs["omega"],
            runs["y"],
            inputs={"x": self.x_range},
            parameters={"omega": self.omega_prior},
        )

    @property
    def omega_prior(self):
        low, high = ((end - self.omega_mean) / self.omega_sd for end in self.omega_range)
        return truncnorm(low, high, loc=self.omega_mean, scale=self.omega_sd)

    @property
    def surrogate(self):
        return hs.PolynomialChaos(degree=5, coefficient_prior=norm(0, 5))


def standardised(draws, expected):
    """Difference of means in reference sds, and ratio of sds minus one."""
    return (
        (np.mean(draws) - expected["mean"]) / expected["sd"],
        np.std(draws) / expected["sd"] - 1,
    )
