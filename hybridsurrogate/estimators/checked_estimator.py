"""Checks of what an estimator is given, before a fit and after it, and what a fit keeps of it."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from numbers import Integral, Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from sklearn.base import BaseEstimator
from sklearn.utils import check_scalar
from sklearn.utils.validation import check_consistent_length, check_is_fitted, validate_data

from hybridsurrogate.arguments.functions import state_to_pickle
from hybridsurrogate.exceptions import did_you_mean
from hybridsurrogate.inference.sampling.emcee_sampler import EnsembleSampler
from hybridsurrogate.likelihoods import Likelihood, as_likelihood
from hybridsurrogate.model.rows.columns import (
    check_reach,
    column_names,
    matched_columns,
    warn_elsewhere,
    warn_outside,
)
from hybridsurrogate.model.rows.experiments import (
    Experiments,
    check_column,
    check_experiments,
    experiments_of,
)
from hybridsurrogate.model.rows.measured_rows import (
    MeasuredRows,
    check_outcomes,
    check_weights,
    merged_rows,
    without_gaps,
)
from hybridsurrogate.model.rows.stacking import Stacking, as_several, stacking_of
from hybridsurrogate.priors import check_prior
from hybridsurrogate.simulation.arrays import (
    as_numbers,
    as_outputs,
    as_table,
    check_size,
    check_spread,
    complete_table,
)
from hybridsurrogate.simulation.outputs import OUTPUT
from hybridsurrogate.simulation.simulator import SimulationData, Simulator
from hybridsurrogate.surrogates.base import Surrogate
from hybridsurrogate.surrogates.families.exact import ExactSurrogate
from hybridsurrogate.surrogates.families.polynomial_chaos import PolynomialChaos
from hybridsurrogate.types import FloatArray

# what a fit keeps of the measured data
_STORED = (
    "measured_", "single_rows_", "row_weights_", "simulation_", "stacking_", "experiments_",
    "_columns", "column_order_", "_rows", "emulation_",
)  # fmt: skip

SAMPLERS = ("auto", "importance", "emcee")


@dataclass(frozen=True, eq=False)
class CheckedData:
    """Measured data as ``fit`` checked them, for it to store at its end.

    Attributes
    ----------
    X, y, weights : ndarray of shape (n, n_columns), (n,), (n,)
        As given, the simulation's inputs first.
    names : ndarray of str of shape (n_columns,), or None
        Columns in the order of ``fit``, where X had names.
    order : sequence of int
        Position in ``fit`` of each column of X.
    rows : MeasuredRows
        The same, equal rows merged.
    simulation : SimulationData, Simulator or None
        Of several outputs with one output a row.
    single : tuple of ndarray, (m, n_columns), (m,) and (m,)
        Rows, outputs and weights with one output each: of a single output those given.
    stacking : Stacking or None
        How several outputs are laid out.
    experiments : Experiments or None
        Which experiment a row is of.
    """

    X: FloatArray
    y: FloatArray
    weights: FloatArray
    names: Any
    order: Sequence[int]
    rows: MeasuredRows
    simulation: SimulationData | Simulator | None
    single: tuple[FloatArray, FloatArray, FloatArray]
    stacking: Stacking | None
    experiments: Experiments | None


class CheckedEstimator(BaseEstimator):
    """Base of the estimators: their parameters, and the measured data in ``fit`` and after it."""

    experiment: str | None = None
    by_experiment: Mapping[str, str] | None = None
    emulation_: Any = None

    def __getstate__(self) -> dict[str, Any]:
        state: dict[str, Any] = super().__getstate__()
        return state_to_pickle(state, type(self).__name__)

    def _check_parameters(self) -> tuple[Surrogate, Likelihood]:
        if self.simulation is not None and not isinstance(
            self.simulation, SimulationData | Simulator
        ):
            raise TypeError(
                "simulation must be SimulationData (Simulator.run, read_simulation), a Simulator "
                f"or None, got {type(self.simulation).__name__}."
            )
        check_experiments(self.experiment, self.by_experiment, self.simulation)
        surrogate = self.surrogate
        if surrogate is None:
            # a simulation that is slow to run was replaced by its runs before
            is_run = isinstance(self.simulation, Simulator)
            surrogate = ExactSurrogate() if is_run else PolynomialChaos()
        if not isinstance(surrogate, Surrogate):
            raise TypeError(
                "surrogate must be a surrogate object such as PolynomialChaos(degree=5) or "
                f"ExactSurrogate(), got {surrogate!r}."
            )
        self._check_beta()
        check_scalar(self.n_draws, "n_draws", Integral, min_val=10)
        if isinstance(self.sampler, EnsembleSampler):
            if self.sampler.file is not None and not isinstance(self.random_state, Integral):
                raise ValueError(
                    "EnsembleSampler(file=...) can only go on with a run whose random_state is an "
                    f"int, got random_state={self.random_state!r}."
                )
        elif not isinstance(self.sampler, str) or self.sampler not in SAMPLERS:
            raise ValueError(
                f"sampler must be one of {SAMPLERS} or an EnsembleSampler, got {self.sampler!r}."
                f"{did_you_mean(self.sampler, SAMPLERS)}"
            )
        if self.noise_prior is not None:
            check_prior(self.noise_prior, "noise_prior")
            if self.noise_prior.support()[1] <= 0:
                raise ValueError(
                    "noise_prior must have mass above zero: it is that of a standard deviation, "
                    f"and ends at {self.noise_prior.support()[1]:g}."
                )
        return surrogate, as_likelihood(self.likelihood)

    def _check_beta(self) -> None:
        if callable(self.beta):
            return
        check_scalar(self.beta, "beta", Real, min_val=0, max_val=1)
        if np.isnan(self.beta):
            raise ValueError("beta must lie between 0 and 1, got NaN.")

    def _beta_at(self, beta_of: Callable[[FloatArray], ArrayLike], X: FloatArray) -> FloatArray:
        """Return the values (n,) of a callable beta at rows X; it gets the simulation's inputs."""
        inputs = X if self.simulation is None else X[:, : len(self.simulation.input_names)]
        beta = np.asarray(beta_of(inputs), dtype=float)
        if beta.shape != (len(inputs),):
            raise ValueError(
                f"beta(X) must return shape ({len(inputs)},) for {len(inputs)} rows of inputs, "
                f"got {beta.shape}."
            )
        if not ((beta >= 0) & (beta <= 1)).all():
            raise ValueError("beta(X) must lie between 0 and 1 for every row.")
        return beta

    def _check_fit_data(
        self,
        X: ArrayLike,
        y: ArrayLike,
        likelihood: Likelihood,
        sample_weight: ArrayLike | None = None,
    ) -> CheckedData:
        # scikit-learn stores names where it finds them; ``fit`` stores nothing before its end
        seen = copy.copy(self)
        check_outcomes(y, likelihood)
        if len(self._output_names(None if y is None else as_table(y, "y"))) == 1:
            X, y, sample_weight = without_gaps(X, y, sample_weight)
        X = complete_table(X, labels=self.experiment)
        tables = [X, *self._further_tables()]
        experiments = experiments_of(tables, self.experiment, self.by_experiment)
        X = X if experiments is None else experiments.numbered(X)
        rows, output = self._checked(seen, X, y, reset=True)
        check_spread(rows, "X")
        check_spread(output, "y")
        names = getattr(seen, "feature_names_in_", None)
        listed = [] if names is None else [str(name) for name in names]
        columns, order = matched_columns(listed, rows.shape[1], self.simulation)
        weights = check_weights(sample_weight, len(output))
        if np.count_nonzero(weights) < 2:
            raise ValueError("sample_weight leaves 1 sample; at least 2 measured rows are needed.")
        likelihood.check_training(output[np.isfinite(output)])
        rows = rows[:, order]
        if experiments is not None:
            inputs = () if self.simulation is None else self.simulation.input_names
            check_column(experiments, columns, rows, inputs)
        check_reach(columns, rows, self.simulation)
        warn_outside(columns, rows, self.simulation)
        warn_elsewhere(output, self.simulation)
        stacking, simulation, single = None, self.simulation, (rows, output, weights)
        if output.ndim > 1:
            # rows of no weight are as if they were not there
            counted = output[weights > 0]
            stacking, simulation = self._stacked_outputs(columns, counted, likelihood)
            columns = (*columns[: stacking.at], OUTPUT, *columns[stacking.at :])
            long, values = stacking.rows(rows), stacking.values(output)
            there = np.isfinite(values)
            single = long[there], values[there], np.repeat(weights, output.shape[1])[there]
        single = (*single[:2], self._counted(columns, *single))
        merged = merged_rows(columns, *single)
        return CheckedData(
            rows, output, weights, names, order, merged, simulation, single, stacking, experiments
        )

    def _counted(
        self, columns: tuple[str, ...], X: FloatArray, y: FloatArray, weights: FloatArray
    ) -> FloatArray:
        """Return the weights (n,) of rows; a subclass may leave some out."""
        return weights

    def _further_tables(self) -> Sequence[Any]:
        """Return measured rows in addition to those in ``fit``, as tables."""
        return ()

    def _checked(
        self, estimator: Any, X: ArrayLike, y: ArrayLike, reset: bool
    ) -> tuple[FloatArray, FloatArray]:
        """Return rows and outputs as floats: (n,), or (n, k) with NaN of several outputs."""
        X, y = complete_table(X), None if y is None else as_table(y, "y")
        names = self._output_names(y)
        if len(names) == 1:
            y = None if y is None else as_numbers(y, "y")
            least = 2 if reset else 1
            rows, output = validate_data(
                estimator, X, y, reset=reset, dtype=np.float64, ensure_min_samples=least
            )
            # what is kept of a fit must not change with the arrays of the caller
            return rows, np.array(output, dtype=float)
        rows = validate_data(estimator, X, reset=reset, dtype=np.float64)
        output = as_several(y, names)
        check_consistent_length(rows, output)
        return rows, output

    def _output_names(self, y: Any) -> tuple[str, ...]:
        """Return the names of the outputs: of the simulation's, else of the columns of y."""
        if self.simulation is not None:
            return self.simulation.outputs
        if np.ndim(y) < 2 or np.shape(y)[1] < 2:
            return ("y",)
        return tuple(column_names(y) or (f"y{k}" for k in range(np.shape(y)[1])))

    def _stacked_outputs(
        self, columns: tuple[str, ...], output: FloatArray, likelihood: Likelihood
    ) -> tuple[Stacking, SimulationData | Simulator | None]:
        """Return how several outputs are laid out, and the simulation with one output a row."""
        if OUTPUT in columns:
            raise ValueError(f"{OUTPUT!r} is a name that the package uses: rename the column.")
        inputs = columns if self.simulation is None else self.simulation.input_names
        names = self._output_names(output)
        scaled = likelihood.scales_noise and not likelihood.log_scale
        stacking = stacking_of(output, names, len(inputs), scaled)
        if self.simulation is None:
            return stacking, None
        return stacking, self.simulation.single_output(stacking.scale)

    def _store(self, data: CheckedData, rows: MeasuredRows | None = None) -> None:
        """Store the measured data of a fit that has ended, and the rows that trained."""
        self.measured_, self.single_rows_ = (data.X, data.y), data.single[:2]
        self.row_weights_ = data.single[2]
        self.simulation_, self.stacking_ = data.simulation, data.stacking
        self.experiments_ = data.experiments
        self._columns, self.column_order_ = data.rows.columns, data.order
        self._rows = data.rows if rows is None else rows
        self.emulation_ = None
        self.n_features_in_ = data.X.shape[1]
        if data.names is not None:
            self.feature_names_in_ = data.names
        elif hasattr(self, "feature_names_in_"):
            del self.feature_names_in_

    def _store_as(self, fitted: CheckedEstimator) -> None:
        """Store the measured data of another estimator, which was fitted to them."""
        for name in ("n_features_in_", "feature_names_in_", *_STORED):
            if hasattr(fitted, name):
                setattr(self, name, getattr(fitted, name))
            elif hasattr(self, name):
                delattr(self, name)

    def checked_rows(self, X: ArrayLike) -> FloatArray:
        """Return rows as the fitted model reads them: the simulation's inputs first.

        Parameters
        ----------
        X : array-like of shape (n, n_columns)

        Returns
        -------
        ndarray of shape (n, n_columns)
            Of k outputs (n k, n_columns + 1): one row for each.
        """
        check_is_fitted(self)
        rows = self._known_columns(validate_data(self, self._in_order(X), reset=False, dtype=float))
        simulation = self._trained_on
        if isinstance(simulation, SimulationData):
            # a simulation that is run itself extrapolates nothing
            warn_outside(self._given_columns, rows, simulation, self.measured_[0])
        return rows if self.stacking_ is None else self.stacking_.rows(rows)

    @property
    def _trained_on(self) -> SimulationData | Simulator | None:
        """The simulation, or the runs of it that the fit made."""
        return self.simulation if self.emulation_ is None else self.emulation_.runs

    @property
    def _given_columns(self) -> tuple[str, ...]:
        return tuple(name for name in self._columns if name != OUTPUT)

    def _back(self, values: FloatArray) -> FloatArray:
        """Return values of rows (..., m) as they were asked for, of several outputs (..., n, k)."""
        return values if self.stacking_ is None else self.stacking_.back(values)

    def measured_outputs(self, y: ArrayLike, word: str = "y") -> FloatArray:
        """Return outputs as the fitted model reads them: of several in the simulation's order.

        Parameters
        ----------
        y : array-like of shape (n,), or (n, k) of several outputs
            With NaN for what was not measured; columns of several go by name in a DataFrame.
        word : str, default="y"
            What to call it in an error.

        Returns
        -------
        ndarray of shape (n,) or (n, k)
        """
        check_is_fitted(self)
        if self.stacking_ is None:
            return as_outputs(y, word, gaps=True)
        return as_several(as_table(y, word), self.stacking_.names, word)

    def _known_columns(self, rows: FloatArray) -> FloatArray:
        """Return rows with the simulation's inputs first, none of them out of all bounds."""
        check_size(rows, "X")
        rows = rows[:, self.column_order_]
        check_reach(self._given_columns, rows, self._trained_on)
        return rows

    def _in_order(self, X: ArrayLike) -> Any:
        """Return columns with the names of those in ``fit`` in their order there."""
        table = complete_table(X, labels=self.experiment)
        if self.experiments_ is not None:
            table = self.experiments_.numbered(table)
        order = list(getattr(self, "feature_names_in_", self._given_columns))
        if sorted(column_names(table)) != sorted(order):
            return table  # scikit-learn says which are missing, or new
        # names that ``fit`` had of the simulation alone are none to scikit-learn
        named = hasattr(self, "feature_names_in_")
        return table[order] if named else as_numbers(table[order], "X")
