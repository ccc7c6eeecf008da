"""A diagnosis with further runs of the simulation, where they inform most."""

from __future__ import annotations

import warnings
from dataclasses import replace
from numbers import Integral, Real
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from sklearn.base import clone
from sklearn.utils import check_scalar

from hybridsurrogate.arguments import check_n_jobs, described
from hybridsurrogate.diagnosis.diagnosis import DiscrepancyDiagnosis
from hybridsurrogate.exceptions import DiagnosisWarning, FailedRunsWarning, HybridSurrogateWarning
from hybridsurrogate.simulation.simulator import SimulationData, Simulator
from hybridsurrogate.simulation.table_file import RUN
from hybridsurrogate.types import FloatArray


def refine(
    diagnosis: DiscrepancyDiagnosis,
    X: ArrayLike,
    y: ArrayLike,
    simulator: Simulator | None = None,
    *,
    budget: int = 40,
    batch: int = 10,
    open_below: float = 0.5,
    n_jobs: int | None = None,
) -> DiscrepancyDiagnosis:
    """Diagnose, run the simulation where its emulator leaves most open, and diagnose again.

    Until the runs leave less open at the measured rows than a share of the noise, or the budget
    ends. Further runs elsewhere do not close what lies between the places of runs that are curves,
    nor the noise of a stochastic simulation or the rounding of counts: where that is most of it, no
    run is spent, and the warning asks for finer places, repeated runs or expected counts.

    Parameters
    ----------
    diagnosis : DiscrepancyDiagnosis
        Its estimator has runs as simulation, `SimulationData`. It is not fitted itself.
    X, y : array-like of shape (n, n_columns), (n,)
        Measured data.
    simulator : Simulator or None, default=None
        None: the one that made the runs.
    budget : int, default=40
        Further runs, at most.
    batch : int, default=10
        Runs at a time.
    open_below : float, default=0.5
        Root mean square of what remains open, in standard deviations of the noise.
    n_jobs : int or None, default=None
        Processes that share the runs of a function that does one at a time.

    Returns
    -------
    DiscrepancyDiagnosis
        Fitted to all runs. Its ``refinement_`` has of each round: runs, what they left open, how
        much of it between their places, verdict, most probable cause and its probability.

    Raises
    ------
    TypeError
        Where there are no runs, or no simulator.

    Warns
    -----
    DiagnosisWarning
        Where the budget ended before, or where runs of another kind are needed.

    Examples
    --------
    >>> import numpy as np
    >>> from scipy.stats import uniform
    >>> import hybridsurrogate as hs
    >>> simulator = hs.Simulator(
    ...     lambda t, rate: np.exp(-rate * t), {"t": (0, 10)}, {"rate": uniform(0.1, 0.4)})
    >>> model = hs.PowerScaledSurrogate(
    ...     simulator.run(8, along=20, random_state=0), surrogate=hs.Kriging(), random_state=0)
    >>> t = np.linspace(0, 10, 20)
    >>> y = np.exp(-0.3 * t) + 0.01 * np.random.default_rng(0).normal(size=20)
    >>> diagnosis = hs.DiscrepancyDiagnosis(model, cv=None, random_state=0)
    >>> hs.refine(diagnosis, t[:, None], y, budget=4, batch=2).verdict_
    'adequate'
    """
    data = _runs_of(diagnosis)
    simulator = data.simulator if simulator is None else simulator
    if not isinstance(simulator, Simulator):
        raise TypeError(
            "refine needs the simulation itself to run: pass simulator=Simulator(...). For a code "
            "that runs elsewhere write diagnosis.next_runs(10) to a file, and add its results by "
            "data.with_rows(frame)."
        )
    check_n_jobs(n_jobs)
    check_scalar(budget, "budget", Integral, min_val=0)
    check_scalar(batch, "batch", Integral, min_val=1)
    check_scalar(open_below, "open_below", Real, min_val=0)
    along = np.unique(data.X[:, 0]) if data.run is not None else None
    rounds: list[dict[str, Any]] = []
    left = int(budget)
    while True:
        current = clone(diagnosis).set_params(estimator__simulation=data, cv=None)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", HybridSurrogateWarning)
            current.fit(X, y)
        rounds.append(_round_of(current, data.n_runs))
        check = current.emulator_check_
        settled = check is None or check.left_open < open_below
        if settled or not left or (check is not None and not check.needs_runs):
            break
        asked = current.next_runs(min(int(batch), left))
        left -= len(asked)
        table = _made(simulator, asked, data, along, n_jobs, bool(diagnosis.progress))
        done = table[table[list(data.outputs)].notna().any(axis=1)]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", FailedRunsWarning)
            data = data.with_rows(table)
        lost = len(asked) - len(done if along is None else np.unique(done[RUN]))
        if lost:
            warnings.warn(
                f"{lost} of {len(asked)} further runs failed and were dropped.",
                FailedRunsWarning,
                stacklevel=2,
            )
    if diagnosis.cv is not None:  # the folds are for the last round
        current = clone(diagnosis).set_params(estimator__simulation=data).fit(X, y)
    else:
        for warning in caught:
            warnings.warn(warning.message, warning.category, stacklevel=2)
    current.refinement_ = pd.DataFrame(rounds)
    current.result_ = replace(current.result_, refinement=current.refinement_)
    if check is not None and not settled:
        why, instead = f"The budget of {budget} further runs ended while they leave", ""
        if not check.needs_runs:
            spent = int(budget) - left
            why = f"{spent} of {budget} further runs were made, and more would not help: they leave"
            instead = f" {check.remedy}"
        warnings.warn(
            f"{why} the simulation open by {check.left_open:.1f} times the noise, above "
            f"open_below={open_below:g}.{instead}",
            DiagnosisWarning,
            stacklevel=2,
        )
    return current


def _runs_of(diagnosis: DiscrepancyDiagnosis) -> SimulationData:
    """Return the runs that a diagnosis rests on; TypeError where there are none."""
    if not isinstance(diagnosis, DiscrepancyDiagnosis):
        raise TypeError(
            "diagnosis must be a DiscrepancyDiagnosis, which need not be fitted, got "
            f"{described(diagnosis)}."
        )
    data = getattr(diagnosis.estimator, "simulation", None)
    if not isinstance(data, SimulationData):
        raise TypeError(
            "refine adds runs to those that there are: the estimator's simulation must be "
            f"SimulationData, such as simulator.run(60, along=50), got {type(data).__name__}."
        )
    return data


def _made(
    simulator: Simulator,
    asked: pd.DataFrame,
    data: SimulationData,
    along: FloatArray | None,
    n_jobs: int | None,
    progress: bool,
) -> pd.DataFrame:
    """Return the rows of runs that are asked for, of fields over their second axis, too."""
    places = asked
    for name, column in zip(data.input_names[1:], data.X.T[1:], strict=True):
        if name not in asked:
            places = places.merge(pd.DataFrame({name: np.unique(column)}), how="cross")
    table = simulator.run_at(places, along, n_jobs, progress=progress)
    if along is not None:
        table[RUN] //= len(places) // len(asked)
    return table


def _round_of(diagnosis: DiscrepancyDiagnosis, n_runs: int) -> dict[str, Any]:
    check, best = diagnosis.emulator_check_, diagnosis.causes_.iloc[0]
    return {
        "n_runs": n_runs,
        "left_open": 0.0 if check is None else check.left_open,
        "between": 0.0 if check is None else check.between,
        "verdict": diagnosis.verdict_,
        "kind": best["kind"],
        "probability": best["probability"],
    }
