"""The user's simulation with a cause in it, and parameters for which it fails itself."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy import stats

from hybridsurrogate.diagnosis.search.search import Search
from hybridsurrogate.effects.base import Cause
from hybridsurrogate.effects.dynamics.dynamic import Dynamic
from hybridsurrogate.likelihoods import Likelihood
from hybridsurrogate.model.posterior import SOME_DRAWS
from hybridsurrogate.model.problem import Problem
from hybridsurrogate.simulation.simulator import Simulator
from hybridsurrogate.types import FloatArray


def failures(result: Search) -> list[str]:
    """Return for each compared cause how often the simulation fails under it, "" for never.

    Sets of parameters from the priors, of the simulation and of the cause, are run at the measured
    rows. A set that fails anywhere is impossible: its density is zero, and the search passes it by.
    Only a simulation that is run directly can fail; an emulator has learned from runs that
    worked.
    """
    notes = []
    for w in result.candidates:
        model, failed = w.fit.model, 0
        may_fail = model.basis.is_simulation and model.n_unknowns
        if may_fail and (w.cause is None or w.cause.touches_simulation):
            # a fixed spread, so that a table is reproducible
            z = np.random.RandomState(0).standard_normal((SOME_DRAWS, model.n_unknowns))
            known, _, _ = model.simulated(result.problem.X, model.values(z))
            failed = int(np.sum(~np.isfinite(known).all(axis=1)))
        notes.append(
            f"the simulation fails for {failed} of {SOME_DRAWS} sets of parameters from the "
            "priors, which count as impossible"
            if failed
            else ""
        )
    return notes


class ExtendedFunction:
    """A simulation function that a cause rewrites; a class so that it can be pickled."""

    def __init__(
        self,
        simulator: Simulator,
        cause: Cause,
        likelihood: Likelihood,
        theta_names: Mapping[str, str],
        coefficient_names: Mapping[str, str],
        unit: float,
    ):
        self.simulator, self.cause, self.likelihood = simulator, cause, likelihood
        self.theta_names, self.coefficient_names = theta_names, coefficient_names
        self.unit = unit  # of the output, in which the cause knows it
        self.__name__ = f"{simulator.name}_with_{cause.kind.replace('-', '_')}"

    def __call__(self, **values: FloatArray) -> FloatArray:
        """Run the extended simulation; arguments by name, arrays or numbers."""
        arrays = dict(zip(values, np.broadcast_arrays(*values.values()), strict=True))
        shape = next(iter(arrays.values())).shape
        rows = {name: np.ravel(array).astype(float) for name, array in arrays.items()}
        simulator = self.simulator
        own = {*self.theta_names.values(), *self.coefficient_names.values()}
        parameters = (*simulator.parameter_names, *simulator.assumed_names)
        X = {k: v for k, v in rows.items() if k not in own and k not in parameters}
        n = len(next(iter(rows.values())))
        assumed = {name: np.full(n, c.value) for name, c in simulator.assumed.items()}
        omega = {name: rows[name] if name in rows else assumed[name] for name in parameters}
        theta = {name: rows[public] for name, public in self.theta_names.items()}
        run_X, run_omega = self.cause.inputs(X, omega, theta)
        inputs = np.column_stack([run_X[name] for name in simulator.input_names])
        points = np.column_stack([run_omega[name] for name in parameters]) if parameters else None
        eta = self.likelihood.link(simulator.evaluate(simulator.held(inputs), points))
        changed = self.cause.response(eta / self.unit, X, theta)
        eta = eta if changed is None else self.unit * changed[0]
        columns = self.cause.columns(X, theta)
        if columns is not None:
            coefficients = [rows[public] for public in self.coefficient_names.values()]
            eta = eta + np.sum(columns * np.column_stack(coefficients), axis=1)
        return self.likelihood.inverse(eta).reshape(shape)


def extend_simulator(simulator: Simulator, cause: Cause, problem: Problem) -> Simulator:
    """Return a simulator whose function contains the cause.

    The cause's numbers become parameters with their priors; a wrong constant moves from the
    assumed constants to the parameters; a column that the simulation ignored becomes an input. A
    cause inside the dynamics gives an `OdeSimulator`. Raises ValueError for a cause that changes
    the noise alone.
    """
    if not cause.changes_output:
        raise ValueError(f"The cause {cause.name!r} leaves the simulation as it is.")
    change = cause.modification
    if change is not None:
        own = cause.priors_of_change if isinstance(cause, Dynamic) else cause.parameters
        priors = {change.full(name): prior for name, prior in own.items()}
        return simulator.modified([change], priors)
    taken = {*simulator.input_names, *simulator.parameter_names, *simulator.assumed_names}
    taken |= set(cause.reads)

    def public(name: str) -> str:
        if cause.replaces is not None:
            return cause.replaces
        free, k = name, 1
        while free in taken:
            longer = f"{cause.kind.replace('-', '_')}_{name}"
            free, k = longer if k == 1 else f"{longer}_{k}", k + 1
        return free

    theta_names = {name: public(name) for name in cause.parameters}
    coefficient_names = {name: public(name) for name in cause.coefficients}
    # a cause in one of several outputs knows it in units of its standard deviation
    unit = cause.unit_of_output
    sd = unit * (cause.coefficient_sd or problem.model.default_sd)
    parameters = {
        **simulator.parameters,
        **{theta_names[name]: prior for name, prior in cause.parameters.items()},
        **{name: stats.norm(0, sd) for name in coefficient_names.values()},
    }
    inputs = dict(simulator.input_ranges)
    for name in cause.reads:
        if name in problem.model.columns and name not in inputs:
            values = problem.X[:, problem.model.columns.index(name)]
            inputs[name] = (float(values.min()), float(values.max()))
    function = ExtendedFunction(
        simulator, cause, problem.likelihood, theta_names, coefficient_names, unit
    )
    return Simulator(
        function,
        inputs,
        parameters,
        {name: c for name, c in simulator.assumed.items() if name != cause.replaces},
        simulator.output,
    )
