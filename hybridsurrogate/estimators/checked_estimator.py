"""Checks of what an estimator is given, before a fit and after it, and what a fit keeps of it."""

from __future__ import annotations

import copy
from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from numbers import Integral, Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from sklearn.base import BaseEstimator
from sklearn.utils import check_scalar
from sklearn.utils.validation import check_consistent_length, check_is_fitted, validate_data

from hybridsurrogate.arguments import check_choice, state_to_pickle
from hybridsurrogate.effects.noise.known_errors import KINDS
from hybridsurrogate.effects.noise.noise import OutputCorrelation
from hybridsurrogate.exceptions import did_you_mean
from hybridsurrogate.inference.sampling.ensembles import EnsembleSampler
from hybridsurrogate.likelihoods import Censored, Likelihood, as_likelihood
from hybridsurrogate.model.rows.columns import (
    check_column,
    check_experiments,
    check_reach,
    column_names,
    experiments_of,
    matched_columns,
    warn_elsewhere,
    warn_outside,
)
from hybridsurrogate.model.rows.measured_data import (
    MeasuredData,
    SingleRows,
    check_covariances,
    check_outcomes,
    check_weights,
    name_of,
    new_errors,
    row_errors,
    taken_out,
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
from hybridsurrogate.surrogates.basis import Surrogate
from hybridsurrogate.surrogates.families.parametric import ExactSurrogate
from hybridsurrogate.surrogates.families.polynomial_chaos import PolynomialChaos
from hybridsurrogate.types import FloatArray

SAMPLERS = ("auto", "importance", "emcee")


class CheckedEstimator(BaseEstimator):
    """Base of the estimators: their parameters, and the measured data in ``fit`` and after it."""

    experiment: str | None = None
    by_experiment: Mapping[str, str] | None = None
    noise: str = "added"
    data_: MeasuredData
    emulation_: Any = None

    @property
    def measured_(self) -> tuple[FloatArray, FloatArray]:
        """The measured rows of the fit, as checked."""
        return self.data_.X, self.data_.y

    def __getstate__(self) -> dict[str, Any]:
        state: dict[str, Any] = super().__getstate__()
        return state_to_pickle(state, type(self).__name__)

    def checked_settings(self) -> tuple[Surrogate, Likelihood]:
        """Return surrogate and likelihood; raise where a parameter is not usable."""
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
        check_choice(self.noise, "noise", KINDS)
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

    def checked_data(
        self,
        X: ArrayLike,
        y: ArrayLike,
        sample_weight: ArrayLike | None = None,
        y_err: Any = None,
    ) -> MeasuredData:
        """Return what was measured, checked as ``fit`` does, which calls this.

        Parameters
        ----------
        X, y, sample_weight, y_err
            As in ``fit``.
        """
        likelihood = self.checked_settings()[1]
        check_outcomes(y, likelihood)
        X, y_err = taken_out(X, y_err)
        error_column = name_of(y_err)
        if len(self.output_names(None if y is None else as_table(y, "y"))) == 1:
            X, y, sample_weight, y_err = without_gaps(X, y, sample_weight, y_err)
        X = complete_table(X, labels=self.experiment)
        tables = [X, *self._further_tables()]
        experiments = experiments_of(tables, self.experiment, self.by_experiment, self.simulation)
        X = experiments.numbered(X)
        # scikit-learn stores names where it finds them; ``fit`` stores nothing before its end
        seen = copy.copy(self)
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
        inputs = () if self.simulation is None else self.simulation.input_names
        check_column(experiments, columns, rows, inputs)
        check_reach(columns, rows, self.simulation)
        warn_outside(columns, rows, self.simulation)
        warn_elsewhere(output, self.simulation)
        stacking, simulation = None, self.simulation
        if output.ndim > 1:
            # rows of no weight are as if they were not there
            counted = output[weights > 0]
            stacking, simulation = self._stacked_outputs(columns, counted, likelihood)
            columns = (*columns[: stacking.at], OUTPUT, *columns[stacking.at :])
        data = MeasuredData(
            rows, output, weights, names, order, columns, simulation, stacking, experiments
        )
        if y_err is not None:
            data = self._with_errors(data, y_err, likelihood, error_column)
        elif stacking is not None:
            data = self._carrying(data, likelihood, None)
        share, sets = self._further_sets(data)
        if sets and data.carried is not None:
            raise ValueError(
                "Errors that are correlated between outputs are those of one measured set: join "
                "the sets in fit, or leave out covariances and OutputCorrelation."
            )
        for further, _ in sets:
            likelihood.check_training(further.y[np.isfinite(further.y)])
            check_reach(data.given_columns, further.X, self.simulation)
            warn_outside(data.given_columns, further.X, self.simulation)
        return data.joined(sets, share) if sets else data

    def _with_errors(
        self, data: MeasuredData, y_err: Any, likelihood: Likelihood, column: str | None
    ) -> MeasuredData:
        """Return measured data with known errors."""
        if self.noise == "known" and self.noise_prior is not None:
            raise ValueError(
                'noise="known" takes the noise from y_err: a noise_prior is for noise="added" or '
                '"scaled".'
            )
        names = self.output_names(data.y)
        errors, correlation = check_covariances(y_err, data.y, likelihood, names)
        scatter = likelihood.scatter(errors, data.y)
        how = row_errors(self.noise, scatter, data.stacking, data.weights)
        if correlation is not None:
            errors = np.broadcast_to(np.asarray(y_err, dtype=float), correlation.shape)
        data = replace(data, errors=how, y_err=errors, scatter=scatter, error_column=column)
        return data if data.stacking is None else self._carrying(data, likelihood, correlation)

    def _carrying(
        self, data: MeasuredData, likelihood: Likelihood, correlation: FloatArray | None
    ) -> MeasuredData:
        """Return data of several outputs with what rows carry where errors are correlated."""
        effects = getattr(self, "effects", ())
        effects = effects if isinstance(effects, list | tuple) else ()
        if correlation is None and not any(isinstance(e, OutputCorrelation) for e in effects):
            return data
        assert data.stacking is not None
        n, k = data.y.shape
        there, values = np.isfinite(data.y).ravel(), data.stacking.values(data.y)
        values[there] = likelihood.working(values[there])
        columns = [np.repeat(np.arange(float(n)), k), values]
        if correlation is not None:
            columns.append(correlation.reshape(n * k, k))
        return replace(data, carried=np.column_stack(columns))

    def _further_tables(self) -> Sequence[Any]:
        """Return measured rows in addition to those in ``fit``, as tables."""
        return ()

    def _further_sets(
        self, data: MeasuredData
    ) -> tuple[float, Sequence[tuple[SingleRows, FloatArray | None]]]:
        """Return these rows checked, and the weight of those in ``fit`` relative to theirs.

        Each with its errors on the scale of eta, where rows have some.
        """
        return 1.0, ()

    def _checked(
        self, estimator: Any, X: ArrayLike, y: ArrayLike, reset: bool
    ) -> tuple[FloatArray, FloatArray]:
        """Return rows and outputs as floats: (n,), or (n, k) with NaN of several outputs."""
        y = None if y is None else as_table(y, "y")
        names = self.output_names(y)
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

    def output_names(self, y: Any) -> tuple[str, ...]:
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
        names = self.output_names(output)
        if isinstance(likelihood, Censored):
            raise ValueError(
                "Censored has limits of one output: fit a simulation of several outputs to each "
                "output by itself, or without limits."
            )
        scaled = likelihood.scales_noise and not likelihood.log_scale
        stacking = stacking_of(output, names, len(inputs), scaled)
        if self.simulation is None:
            return stacking, None
        return stacking, self.simulation.single_output(stacking.scale)

    def _store(self, data: MeasuredData) -> None:
        """Store the measured data of a fit that has ended."""
        self.data_, self.emulation_ = data, None
        self.n_features_in_ = data.X.shape[1]
        if data.names is not None:
            self.feature_names_in_ = data.names
        elif hasattr(self, "feature_names_in_"):
            del self.feature_names_in_

    def checked_rows(
        self, X: ArrayLike, y_err: Any = None, y: FloatArray | None = None
    ) -> FloatArray:
        """Return rows as the fitted model reads them: the simulation's inputs first.

        Parameters
        ----------
        X : array-like of shape (n, n_columns)
        y_err : float, str, array-like of shape (n,), or (n, k) of several outputs, or None
            Errors of measurements there. None: those in X, if ``fit`` took a column of it, or
            typical ones.
        y : ndarray of shape (n,), or (n, k) of several outputs, or None
            Measurements, to which errors are relative on a logarithmic scale. None: predictions.

        Returns
        -------
        ndarray of shape (n, n_columns)
            Of k outputs (n k, n_columns + 1): one row for each. Errors are the last column.
        """
        check_is_fitted(self)
        X, y_err = new_errors(X, y_err, self.data_)
        rows = self._known_columns(validate_data(self, self._in_order(X), reset=False, dtype=float))
        simulation = self._trained_on
        if isinstance(simulation, SimulationData):
            # a simulation that is run itself extrapolates nothing
            warn_outside(self.data_.given_columns, rows, simulation, self.measured_[0])
        rows = rows if self.data_.stacking is None else self.data_.stacking.rows(rows)
        if y_err is None:
            return self.data_.as_measured(rows)
        return self._with_new_errors(rows, y_err, y)

    @abstractmethod
    def _with_new_errors(self, rows: FloatArray, y_err: Any, y: FloatArray | None) -> FloatArray:
        """Return single rows with errors of measurements y there, as `checked_rows` does."""

    @property
    def _trained_on(self) -> SimulationData | Simulator | None:
        """The simulation, or the runs of it that the fit made."""
        return self.simulation if self.emulation_ is None else self.emulation_.runs

    def _back(self, values: FloatArray) -> FloatArray:
        """Return values of rows (..., m) as they were asked for, of several outputs (..., n, k)."""
        return values if self.data_.stacking is None else self.data_.stacking.back(values)

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
        if self.data_.stacking is None:
            return as_outputs(y, word, gaps=True)
        return as_several(as_table(y, word), self.data_.stacking.names, word)

    def _known_columns(self, rows: FloatArray) -> FloatArray:
        """Return rows with the simulation's inputs first, none of them out of all bounds."""
        check_size(rows, "X")
        rows = rows[:, self.data_.order]
        check_reach(self.data_.given_columns, rows, self._trained_on)
        return rows

    def _in_order(self, X: ArrayLike) -> Any:
        """Return columns with the names of those in ``fit`` in their order there."""
        table = complete_table(X, labels=self.experiment)
        table = self.data_.experiments.numbered(table)
        order = list(getattr(self, "feature_names_in_", self.data_.given_columns))
        if sorted(column_names(table)) != sorted(order):
            return table  # scikit-learn says which are missing, or new
        # names that ``fit`` had of the simulation alone are none to scikit-learn
        named = hasattr(self, "feature_names_in_")
        return table[order] if named else as_numbers(table[order], "X")
