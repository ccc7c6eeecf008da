"""Data inside the package with a simulation that lacks something, by name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from hybridsurrogate.datasets import load_mauna_loa_co2, load_nile, make_log_sin


class Demonstration(NamedTuple):
    """What it is, its simulation and its data, rows held out."""

    introduction: str
    simulator: Any
    X: Any
    y: Any
    test: tuple[Any, Any] | None = None


def nile() -> Demonstration:
    """Return a river that changed, which the simulation does not: one cause, and a known one."""
    data = load_nile()
    return Demonstration(
        "Annual flow of the Nile at Aswan, 1871 to 1970, against a simulation of constant flow.",
        data.simulator,
        data.data,
        np.asarray(data.target),
    )


def co2() -> Demonstration:
    """Return seasons that the simulation lacks, with more than noise left after them."""
    data = load_mauna_loa_co2()
    early = (data.data["year"] < 1996).to_numpy()
    return Demonstration(
        "Monthly CO2 at Mauna Loa, 1958 to 1995 (1996 to 2001 held out), against a simulation of "
        "smooth growth: a pre-industrial level plus an excess that grows exponentially.",
        data.simulator,
        data.data[early],
        np.asarray(data.target)[early],
        (data.data[~early], np.asarray(data.target)[~early]),
    )


def log_sin() -> Demonstration:
    """Return the published case, of which several causes are as probable within few rows."""
    case = make_log_sin(random_state=0)
    return Demonstration(
        "Case study 1 of arXiv 2412.11875: 30 rows of a process in x = 1 to 100, against a "
        "simulation that lacks one of its terms (x = 100 to 200 held out).",
        case.simulator,
        case.X,
        case.y,
        (case.X_out, case.y_out),
    )


DEMONSTRATIONS: dict[str, tuple[Callable[[], Demonstration], str]] = {
    "nile": (nile, "flow of the Nile against a constant (measured, public domain)"),
    "co2": (co2, "hard: Mauna Loa CO2 against smooth growth (measured, public domain)"),
    "log-sin": (log_sin, "hard: the published case study 1 (generated)"),
}
