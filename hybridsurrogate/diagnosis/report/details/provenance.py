"""How the numbers were computed: enough to run it again."""

from __future__ import annotations

import hashlib
import platform
from dataclasses import fields
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np
import pandas as pd

from hybridsurrogate.diagnosis.fitting.result import DiagnosisResult
from hybridsurrogate.diagnosis.report.elements.section import Section, Table
from hybridsurrogate.diagnosis.report.elements.view import View

_PACKAGES = ("hybridsurrogate", "numpy", "scipy", "scikit-learn", "emcee", "matplotlib")
_BIBTEX = """@article{reiser2024bayesian,
  title   = {Bayesian Surrogate Training on Multiple Data Sources: A Hybrid Modeling Strategy},
  author  = {Reiser, Philipp and B{\\"u}rkner, Paul-Christian and Guthke, Anneli},
  journal = {arXiv preprint arXiv:2412.11875},
  year    = {2024}
}
"""


def section(view: View) -> Section:
    """Return the section."""
    result = view.result
    priors = result.before.simulation.parameters
    units = [view.units.get(name, "") for name in priors]
    prior_table = pd.DataFrame(
        {"parameter": [*priors], "unit": units, "prior": [*map(_distribution, priors.values())]}
    )
    names = ["Python", "machine", *_PACKAGES]
    there = [platform.python_version(), platform.platform(), *map(installed, _PACKAGES)]
    versions = pd.DataFrame({"what": names, "version": there})
    return Section(
        "How this was computed",
        "settings, versions, priors, citation",
        (
            f"Fingerprint of the measured data (SHA-256): {fingerprint(view)}.",
            "To cite: the paper below, and the version of the package.",
        ),
        code=f"{result.settings.text}\n\n{_BIBTEX}",
        tables=(
            Table(_settings(result), "Settings of this diagnosis"),
            Table(prior_table, "Priors of the simulation's parameters"),
            Table(versions, "Versions"),
        ),
    )


def installed(name: str) -> str:
    """Return the version of an installed package."""
    try:
        return version(name)
    except PackageNotFoundError:
        return "unknown"


def fingerprint(view: View) -> str:
    """Return the SHA-256 of the measured inputs and outputs, as little-endian doubles."""
    made = hashlib.sha256()
    for values in view.result.before.measured_:
        made.update(np.ascontiguousarray(values, dtype="<f8").tobytes())
    return made.hexdigest()


def _settings(result: DiagnosisResult) -> pd.DataFrame:
    own = {f.name: getattr(result.settings, f.name) for f in fields(result.settings) if f.repr}
    rows = [(name, str(own[name])) for name in sorted(own)]
    model = result.before.get_params(deep=False)
    shown = ("beta", "likelihood", "sampler", "n_draws", "random_state", "experiment")
    rows += [(f"estimator: {name}", str(model[name])) for name in shown if name in model]
    return pd.DataFrame(rows, columns=["setting", "value"])


def _distribution(prior: Any) -> str:
    """Return a frozen distribution as the call that makes it."""
    name = getattr(getattr(prior, "dist", None), "name", type(prior).__name__)
    numbers = [f"{value:.6g}" for value in getattr(prior, "args", ())]
    numbers += [f"{key}={value:.6g}" for key, value in getattr(prior, "kwds", {}).items()]
    return f"{name}({', '.join(numbers)})"
