"""What the estimators share: predictions of a mixture of posteriors, scores, a notebook's view."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import replace
from numbers import Real
from typing import Any, Self

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from sklearn import get_config
from sklearn.base import RegressorMixin
from sklearn.utils import _safe_indexing, check_random_state
from sklearn.utils.validation import check_consistent_length, check_is_fitted

from hybridsurrogate.arguments import check_flag, check_number, check_units
from hybridsurrogate.arviz_groups import arviz_of
from hybridsurrogate.estimators.checked_estimator import CheckedEstimator
from hybridsurrogate.estimators.emulation import emulated, take
from hybridsurrogate.exceptions import did_you_mean
from hybridsurrogate.inference.loo import PointwiseLoo
from hybridsurrogate.likelihoods import Likelihood
from hybridsurrogate.likelihoods.censored import Censored, limits_of_rows
from hybridsurrogate.model.posterior import Diagnostics, Posterior
from hybridsurrogate.model.rows.measured_data import (
    MeasuredData,
    check_weights,
    has_measurement,
    new_errors,
    with_new_errors,
)
from hybridsurrogate.model.rows.stacking import as_several
from hybridsurrogate.notebook import table
from hybridsurrogate.numerics import digits
from hybridsurrogate.prediction.leave_one_out import Loo, loo_of_rows
from hybridsurrogate.prediction.mixture import (
    Mixture,
    MixtureAt,
    central_interval,
    curves,
    inside_intervals,
    log_density_of,
    moments,
    noise_free,
    noisy,
    row_blocks,
    samples,
    warn_of_carried,
)
from hybridsurrogate.prediction.variables import MixturePart, summary_of
from hybridsurrogate.simulation.arrays import as_numbers, as_table, check_size
from hybridsurrogate.types import FloatArray


def _fitted_html(estimator: Any, draws: Sequence[tuple[str, Any, Posterior, Diagnostics]]) -> str:
    """Return what was fitted, and the quality of the draws, as HTML; nothing is computed.

    Parameters
    ----------
    estimator : estimator
        Fitted.
    draws : sequence of (name, weight, Posterior, Diagnostics)
        A weight that differs between rows is None.

    Returns
    -------
    str
    """
    rows = len(estimator.measured_[1])
    posteriors = [posterior for _, _, posterior, _ in draws]
    lines = [("Fitted to", f"{rows} rows")]
    if estimator.simulation is not None:
        lines.append(("Simulation", repr(estimator.simulation)))
    beta = getattr(estimator, "beta_", getattr(estimator, "beta", None))
    if beta is not None and not isinstance(beta, str):
        lines.append(("Weight beta", "differs between rows" if callable(beta) else f"{beta:.3g}"))
    # of several posteriors every name once
    causes = dict.fromkeys(effect.name for one in posteriors for effect in one.model.effects)
    if causes:
        lines.append(("Causes", ", ".join(causes)))
    unknowns = dict.fromkeys(name for one in posteriors for name in one.named())
    lines.append(("Unknowns", ", ".join(unknowns)))
    header = ("", "weight", "draws", "step 1", "step 2", "quality")
    quality = [_quality(*one) for one in draws]
    return (
        table(lines, caption=type(estimator).__name__)
        + table(quality, header, "Draws of the posterior")
        + "<p>Estimates: <code>.summary()</code></p>"
    )


def _quality(name: str, weight: Any, posterior: Posterior, found: Diagnostics) -> tuple[str, ...]:
    problems = found.problems()
    return (
        name,
        "differs between rows" if weight is None else digits.percent(weight),
        str(posterior.n_draws),
        _step(found.sampler, found.effective_draws, found.khat),
        _step(found.second_step, found.second_effective_draws, found.second_khat),
        f"doubtful: {'; '.join(problems)}" if problems else "good",
    )


def _step(sampler: str, effective: float, khat: float) -> str:
    words = [sampler]
    if np.isfinite(effective):
        words.append(f"{effective:.0f} effective")
    if np.isfinite(khat):
        words.append(f"k-hat {khat:.2f}")
    return ", ".join(words)


class SurrogateEstimator(RegressorMixin, CheckedEstimator):
    """Base of the estimators; subclasses implement ``fit_data`` and ``_mixture``."""

    diagnostics_: Any
    posterior_: Any
    inference_: Any

    def fit(
        self,
        X: ArrayLike,
        y: ArrayLike,
        sample_weight: ArrayLike | None = None,
        y_err: Any = None,
    ) -> Self:
        """Fit to measured data.

        Parameters
        ----------
        X : array-like of shape (n, n_columns)
            The simulation's inputs by name (DataFrame) or first (array); further columns are for
            causes that use them.
        y : array-like of shape (n,), or (n, k) of several outputs
            With NaN for what was not measured; columns of a DataFrame go by name.
        sample_weight : array-like of shape (n,) or None, default=None
            Powers of the likelihoods of single rows, relative to the measured data's: a row of
            weight two counts like two equal rows.
        y_err : float, str, array-like of the shape of y, or None, default=None
            Known standard deviation of each measurement, in the units of y: its error bar. Of what
            else is inferred: see ``noise``. A name: that column of a DataFrame X, of several
            outputs a list of names. One number: that of every row. Under a log-normal likelihood
            the standard deviation of log y is ``y_err / y``; under a Student-t one it is the scale
            of the row. Of several outputs also the covariance of the errors of a row, in squared
            units of y: shape (n, k, k), or (k, k) for all rows.

        Returns
        -------
        self
        """
        data = self.checked_data(X, y, sample_weight, y_err)
        found = emulated(self, data)
        return self.fit_data(data) if found is None else take(self, found)

    def fit_data(self, data: MeasuredData) -> Self:
        """Fit to data that `checked_data` returned.

        Parameters
        ----------
        data : MeasuredData

        Returns
        -------
        self
        """
        raise NotImplementedError(f"{type(self).__name__} is fitted by its estimators.")

    @abstractmethod
    def _mixture(self, X: FloatArray | None = None) -> list[tuple[Any, Posterior]]:
        """Return the fitted posteriors with their weights, which sum to one.

        At rows X weights may be arrays (n,); without rows they are means over the measured ones.
        """

    def _learned(self, X: FloatArray | None = None) -> list[tuple[Any, Posterior]]:
        """Return `_mixture` without effects that are drawn from their priors alone."""
        return self._mixture(X)

    @property
    def _has_prior_only(self) -> bool:
        """Whether there are such effects, so that `_learned` is another mixture."""
        pairs = zip(self._learned(), self._mixture(), strict=True)
        return any(learned is not whole for (_, learned), (_, whole) in pairs)

    def _with_new_errors(self, rows: FloatArray, y_err: Any, y: FloatArray | None) -> FloatArray:
        likelihood = self._mixture()[0][1].plain_likelihood
        if y is None:
            expected = np.zeros(len(rows))
            if likelihood.log_scale:
                drawn = samples(self._learned, rows, None, check_random_state(0), noise_free)
                expected = np.median(drawn, axis=0)
            y = self._back(expected)
        return with_new_errors(rows, y_err, y, self.data_, likelihood)

    def predict(
        self, X: ArrayLike, return_std: bool = False, y_err: Any = None
    ) -> FloatArray | tuple[FloatArray, FloatArray]:
        """Return the posterior predictive mean of y.

        Effects that are drawn from their priors alone, such as a `Remainder`, have mean zero. They
        widen intervals and leave this mean unchanged.

        Parameters
        ----------
        X : array-like of shape (n, n_columns)
        return_std : bool, default=False
            Also return the standard deviation of y, noise included.
        y_err : float, str, array-like of shape (n,), or (n, k) of several outputs, or None
            After a fit with errors: those of measurements at these rows. None: those in the column
            of X that ``fit`` took, or the median error in ``fit``.

        Returns
        -------
        mean : ndarray of shape (n,), or (n, k) of several outputs
        std : ndarray of the same shape
            Only with ``return_std=True``.

        Raises
        ------
        ValueError
            For NaN or infinity in X.

        Warns
        -----
        FailedRunsWarning
            Where the simulation fails for some draws, which count as impossible: NaN where it does
            for all.
        """
        check_flag(return_std, "return_std")
        X = self.checked_rows(X, y_err)
        cuts = row_blocks(self._mixture, X)
        once = return_std and not self._has_prior_only
        pieces = [moments(self._learned(X[some]), X[some], with_variance=once) for some in cuts]
        mean, carried, *variance = (np.concatenate(piece) for piece in zip(*pieces, strict=True))
        warn_of_carried(carried)
        if not return_std:
            return self._back(mean)
        if not once:
            wide = [
                moments(self._mixture(X[some]), X[some], with_variance=True)[2] for some in cuts
            ]
            variance = [np.concatenate(wide)]
        return self._back(mean), self._back(np.sqrt(variance[0]))

    def predict_interval(
        self,
        X: ArrayLike,
        level: float = 0.9,
        y_err: Any = None,
        below: ArrayLike | None = None,
        above: ArrayLike | None = None,
    ) -> tuple[FloatArray, FloatArray]:
        """Return a central interval that covers a new y with the given probability.

        Quantiles of the mixture over draws, exact up to the draws. Under a
        likelihood that is not normal, quantiles of 20000 draws of y.

        Parameters
        ----------
        X : array-like of shape (n, n_columns)
        level : float, default=0.9
        y_err : float, str, array-like or None
            As in `predict`.
        below, above : float, array-like of shape (n,), (k,) or (n, k), or None, default=None
            Limits of the instrument at these rows, in units of y; NaN: there is none. Of several
            outputs one of each, or of each value. The interval is that of what is recorded.

        Returns
        -------
        lower, upper : ndarray of shape (n,), or (n, k) of several outputs
        """
        check_number(level, "level", Real, min_val=0, max_val=1, include_boundaries="neither")
        X = self.checked_rows(X, y_err)
        ends = central_interval(self._recorded(below, above), X, level)
        lower, upper = (self._back(end) for end in ends)
        low, high = self._limits(len(lower), below, above)
        return np.clip(lower, low, high), np.clip(upper, low, high)

    def interval_holds(
        self,
        X: ArrayLike,
        y: ArrayLike,
        levels: Sequence[float] = (0.9,),
        y_err: Any = None,
        below: ArrayLike | None = None,
        above: ArrayLike | None = None,
    ) -> list[FloatArray]:
        """Return whether the central interval of each level covers each row of y, as 0 and 1.

        Exact for the mixture over draws, without its quantiles. A y at a limit stands for all
        beyond it: it is covered where the interval reaches there.

        Parameters
        ----------
        X : array-like of shape (n, n_columns)
        y : array-like of shape (n,), or (n, k) of several outputs
        levels : sequence of float, default=(0.9,)
        y_err : float, str, array-like or None
            As in `predict`.
        below, above : float, array-like or None, default=None
            As in `log_predictive_density`.

        Returns
        -------
        list of ndarray of shape (n,), or (n, k) of several outputs
            One for each level; NaN where nothing was measured.
        """
        levels = np.ravel(as_numbers(levels, "levels")).tolist()
        for level in levels:
            check_number(level, "levels", Real, min_val=0, max_val=1, include_boundaries="neither")
        check_consistent_length(X, y)
        y = self.measured_outputs(y)
        X = self.checked_rows(X, y_err, y)
        values, mixture_at = self._at_limits(y, below, above)
        there = np.isfinite(values)
        inside = inside_intervals(mixture_at, X[there], values[there], levels)
        return [_spread_out(one, there).reshape(y.shape) for one in inside]

    def sample_predictive_mean(
        self, X: ArrayLike, n_draws: int | None = None, random_state: Any = None
    ) -> FloatArray:
        """Draw the mean of y given the unknowns: the prediction without its noise.

        Parameters
        ----------
        X : array-like of shape (n, n_columns)
        n_draws : int or None, default=None
            None: every draw of the posterior once.
        random_state : int, RandomState or None

        Returns
        -------
        ndarray of shape (n_draws, n), or (n_draws, n, k) of several outputs
        """
        X = self.checked_rows(X)
        random = check_random_state(self.random_state if random_state is None else random_state)
        return self._back(samples(self._mixture, X, n_draws, random, noise_free))

    def sample_posterior_predictive(
        self,
        X: ArrayLike,
        n_draws: int | None = None,
        random_state: Any = None,
        y_err: Any = None,
        below: ArrayLike | None = None,
        above: ArrayLike | None = None,
    ) -> FloatArray:
        """Draw new measurements, noise included.

        Parameters
        ----------
        X, n_draws, random_state
            As in `sample_predictive_mean`.
        y_err : float, str, array-like or None
            As in `predict`.
        below, above : float, array-like of shape (n,), (k,) or (n, k), or None, default=None
            Limits of the instrument at these rows, in units of y; NaN: there is none. Of several
            outputs one of each, or of each value. Draws are of what is recorded.

        Returns
        -------
        ndarray of shape (n_draws, n), or (n_draws, n, k) of several outputs
        """
        X = self.checked_rows(X, y_err)
        random = check_random_state(self.random_state if random_state is None else random_state)
        draws = self._back(samples(self._recorded(below, above), X, n_draws, random, noisy))
        return np.clip(draws, *self._limits(draws.shape[1], below, above))

    def log_predictive_density(
        self,
        X: ArrayLike,
        y: ArrayLike,
        y_err: Any = None,
        below: ArrayLike | None = None,
        above: ArrayLike | None = None,
    ) -> FloatArray:
        """Return the log posterior predictive density of each measured row.

        Where the errors of several outputs are correlated, that of each output given those before
        it in the row: they add up to the density of the row.

        Parameters
        ----------
        X : array-like of shape (n, n_columns)
        y : array-like of shape (n,), or (n, k) of several outputs
        y_err : float, str, array-like or None
            Known errors of y, as in `predict`.
        below, above : float, array-like of shape (n,), (k,) or (n, k), or None, default=None
            Limits of the instrument at these rows, in units of y; NaN: there is none. Of several
            outputs one of each, or of each value. A y at its limit or beyond counts with the
            probability of that. None: those of the likelihood.

        Returns
        -------
        ndarray of shape (n,), or (n, k) of several outputs
            NaN where none was measured. Minus infinity where a row is impossible: where the
            simulation has no finite output for any draw, the likelihood has no density, or y is
            further from all draws than a double can hold.

        Raises
        ------
        ValueError
            For NaN or infinity in X.
        """
        check_is_fitted(self)
        X, y_err = new_errors(X, y_err, self.data_)
        X, y, stacking = self._in_order(X), as_table(y, "y"), self.data_.stacking
        there = has_measurement(y)
        if stacking is None and there.any() and np.shape(X)[:1] == there.shape:
            X, y = (_safe_indexing(table, np.flatnonzero(there)) for table in (X, y))
            if y_err is not None and np.shape(y_err) == there.shape:
                y_err = as_numbers(y_err, "y_err")[there]
            below, above = (
                one if one is None or np.shape(one) != there.shape else np.asarray(one)[there]
                for one in (below, above)
            )
        elif stacking is None and len(there) and not there.any():
            raise ValueError("Input y contains NaN alone: no row has a measurement.")
        rows, output = self._checked(self, X, y, reset=False)
        check_size(output, "y")
        values, mixture_at = self._at_limits(output, below, above)
        rows = self._known_columns(rows)
        rows = rows if stacking is None else stacking.rows(rows)
        if y_err is not None:
            rows = self._with_new_errors(rows, y_err, output)
        if stacking is None:
            return _spread_out(self._log_density(rows, values, mixture_at), there)
        there = np.isfinite(values)
        if self.data_.carried is not None:
            rows = rows if y_err is not None else self.data_.as_measured(rows)
            likelihood = mixture_at(rows[:1])[0][1].likelihood
            # a value that is not known is no value to be given
            limited = (likelihood.side(values) != 0).reshape(output.shape).any(axis=1)
            given = there & ~np.repeat(limited, output.shape[1])
            likelihood.check(values[there])
            rows[given, self.data_.measured_at] = likelihood.working(values[given])
        density = self._log_density(rows[there], values[there], mixture_at)
        # a probability has no unit
        inside = mixture_at(rows[:1])[0][1].likelihood.side(values[there]) == 0
        density -= np.where(inside, stacking.log_scale(rows[there]), 0.0)
        return _spread_out(density, there).reshape(output.shape)

    @staticmethod
    def _log_density(rows: FloatArray, output: FloatArray, mixture_at: MixtureAt) -> FloatArray:
        """Return the log predictive density of checked rows with one output each, (n,)."""
        if not len(rows):
            return np.empty(0)
        mixture_at(rows[:1])[0][1].likelihood.check(output)
        return np.concatenate(
            [
                log_density_of(mixture_at(rows[some]), rows[some], output[some])
                for some in row_blocks(mixture_at, rows)
            ]
        )

    def _limits(self, n: int, below: ArrayLike | None, above: ArrayLike | None) -> tuple[Any, Any]:
        """Return lower and upper limits of new rows, like their y; infinite where there is none."""
        names = () if self.data_.stacking is None else self.data_.stacking.names
        below, above = (
            as_several(limits, names, word)
            if isinstance(limits, pd.DataFrame) and names
            else limits
            for limits, word in ((below, "below"), (above, "above"))
        )
        return limits_of_rows(n, below, above, names)

    def _at_limits(
        self, y: FloatArray, below: ArrayLike | None, above: ArrayLike | None
    ) -> tuple[FloatArray, MixtureAt]:
        """Return single values, marked at their limits, and the mixture that knows the marks."""
        stacking = self.data_.stacking
        single = np.asarray if stacking is None else stacking.values
        if below is None and above is None:
            return single(y), self._mixture
        plain = self._mixture()[0][1].plain_likelihood
        limits = zip((below, above), self._limits(len(y), below, above), strict=True)
        ends = [None if given is None else single(end) for given, end in limits]
        values, likelihood = Censored.of_new_rows(single(y), plain, *ends)
        return values, self._mixture_with(likelihood)

    def _recorded(self, below: ArrayLike | None, above: ArrayLike | None) -> MixtureAt:
        """Return the mixture without those limits of its likelihood in whose place others are."""
        likelihood = self._mixture()[0][1].plain_likelihood
        if not isinstance(likelihood, Censored):
            return self._mixture
        kept = [
            known if given is None else None
            for known, given in ((likelihood.below, below), (likelihood.above, above))
        ]
        return self._mixture_with(replace(likelihood, below=kept[0], above=kept[1]))

    def _mixture_with(self, likelihood: Likelihood) -> MixtureAt:
        def mixture_at(X: FloatArray | None = None) -> Mixture:
            return [(w, replace(p, plain_likelihood=likelihood)) for w, p in self._mixture(X)]

        return mixture_at

    def side_of(self, y: FloatArray) -> NDArray[np.int_]:
        """Return -1 for outputs at a lower limit of the likelihood, 1 at an upper one, else 0.

        Parameters
        ----------
        y : ndarray of shape (n,), or (n, k) of several outputs
        """
        return self._mixture()[0][1].plain_likelihood.side(y)

    def score(
        self,
        X: ArrayLike,
        y: ArrayLike,
        sample_weight: ArrayLike | None = None,
        y_err: Any = None,
        below: ArrayLike | None = None,
        above: ArrayLike | None = None,
    ) -> float:
        """Return the expected log predictive density: its mean over all that was measured.

        Parameters
        ----------
        X : array-like of shape (n, n_columns)
        y : array-like of shape (n,), or (n, k)
        sample_weight : array-like of shape (n,) or None
            Weights of the rows in the mean.
        y_err : float, str, array-like or None
            Known errors of y, as in `predict`.
        below, above : float, array-like or None, default=None
            Limits of the instrument, as in `log_predictive_density`.
        """
        values = self.log_predictive_density(X, y, y_err, below, above)
        if sample_weight is None:
            return float(np.nanmean(values))
        weights = check_weights(sample_weight, len(values))
        if values.ndim > 1:
            weights = np.repeat(weights[:, None], values.shape[1], axis=1)
        there = ~np.isnan(values)
        return float(np.average(values[there], weights=weights[there]))

    def loo(self, progress: bool = False) -> Loo:
        """Return the leave-one-out score: the density of each measured row given the others.

        Pareto-smoothed importance sampling with the weights that belong to a power-scaled
        posterior. Each row for which it fails is left out in a separate fit.

        Parameters
        ----------
        progress : bool, default=False
            Show a progress bar of these fits.

        Returns
        -------
        Loo
            In the order of the rows in ``fit``, of several outputs of what was measured, row by
            row; rows of no weight have their predictive density.
        """
        check_is_fitted(self)
        progress = check_flag(progress, "progress")
        return loo_of_rows(self._pointwise_loo(progress), self.data_, self._mixture)

    @abstractmethod
    def _pointwise_loo(self, progress: bool = False) -> PointwiseLoo:
        """Return leave-one-out densities of the rows given to ``fit``, NaN without weight."""

    def summary(self, units: Mapping[str, str] | None = None) -> pd.DataFrame:
        """Return the estimates: parameters, noise, and what causes report.

        Parameters
        ----------
        units : dict of str to str or None, default=None
            Units of parameters and of the output, such as ``{"rate": "1/h"}``.

        Returns
        -------
        pandas.DataFrame
            Indexed by name; a parameter that differs between experiments has a row for each, such
            as ``rate[b1]``. Columns: "experiment" and "cause" (empty where there is none), "mean",
            "sd", "q5" and "q95" (5 % and 95 % quantiles of the posterior), "ess" (effective sample
            size of step 1, at most the number of draws kept), "khat" (largest Pareto k-hat of both
            steps; above 0.7 the draws are doubtful), and "source": "prior" for a cause that is
            drawn from its prior alone. A mixture of posteriors also has "model" and "weight". Where
            the fit emulated a slow simulation, "simulation" has the number of runs. With ``units``
            also "unit", empty where none is given; the noise has that of the output.

        Raises
        ------
        ValueError
            For units of what is no parameter, output or column.
        TypeError
            For units that are no dict of text.

        Examples
        --------
        >>> import hybridsurrogate as hs
        >>> from hybridsurrogate.datasets import make_log_sin
        >>> case = make_log_sin(random_state=0)
        >>> model = hs.PowerScaledSurrogate(case.simulation, random_state=0).fit(case.X, case.y)
        >>> list(model.summary().index)
        ['omega', 'sigma']
        """
        check_is_fitted(self)
        table = summary_of(self._parts())
        if units is not None:
            table.insert(0, "unit", self._units_of(list(table.index), check_units(units)))
        if self.emulation_ is None:
            return table
        return table.assign(simulation=f"emulated, {self.emulation_.runs.n_runs} runs")

    def _units_of(self, names: Sequence[str], units: Mapping[str, str]) -> list[str]:
        """Return the unit of each row of a summary."""
        simulation = self.data_.simulation
        outputs: tuple[str, ...] = getattr(simulation, "outputs", ())
        inputs: tuple[str, ...] = getattr(simulation, "input_names", ())
        columns = [*inputs, *getattr(self, "feature_names_in_", ())]
        plain = [name.partition("[")[0] for name in names]
        unknown = [name for name in units if name not in (*plain, *outputs, *columns)]
        if unknown:
            known = list(dict.fromkeys([*plain, *outputs, *columns]))
            raise ValueError(
                f"units has {unknown}, which is no parameter, output or column: these are {known}."
                f"{did_you_mean(unknown, known)}"
            )
        of_noise = units.get(outputs[0], "") if len(outputs) == 1 else ""
        of_rows = {"sigma": of_noise, **units}
        return [of_rows.get(name, "") for name in plain]

    def _parts(self) -> list[MixturePart]:
        """Return the posteriors of `_mixture`, without rows, with what is known of them."""
        (weight, posterior), *_ = self._mixture()
        return [
            MixturePart(weight, posterior, self.diagnostics_, self.inference_.problem.noise_prior)
        ]

    def to_arviz(self) -> Any:
        """Return posterior, prior, log likelihood, log prior, predictions and data for ArviZ.

        ``arviz.loo`` of it is wrong where the measured likelihood has a power other than one, and
        where draws are of two surrogates: use `loo`. ``log_prior`` is that of step 2, which has
        the measured rows and the original priors. `arviz.psens` estimates how sensitive it is.

        Returns
        -------
        InferenceData (ArviZ 0.x) or DataTree (ArviZ 1.x)
            Variables: parameters by name, ``sigma``, ``coefficients``, ``y``. A parameter that
            differs between experiments has a dimension with their labels, named like their column;
            where it is spread, also ``p_mean`` and ``p_spread``. What is drawn from its prior
            alone is left out. One chain: draws of an ensemble are thinned and in random order, and
            its walkers are no independent chains. Where a parameter is called so itself:
            ``noise_sigma``, ``surrogate_coefficients``; for one called like a dimension of ArviZ:
            ``parameter_chain``, ``parameter_draw``.
        """
        check_is_fitted(self)
        X, y, _ = self.data_.single
        random = check_random_state(self.random_state)
        posteriors, followed = curves(self._mixture(X), None, random)
        priors = {id(part.posterior.model): part.noise_prior for part in self._parts()}
        noise_priors = [priors[id(posterior.model)] for posterior in posteriors]
        return arviz_of(posteriors, noise_priors, followed, X, y, random)

    def _draws(self) -> list[tuple[str, Any, Posterior, Diagnostics]]:
        """Return each posterior with its name, its weight and how its draws were made."""
        return [("posterior", 1.0, self.posterior_, self.diagnostics_)]

    def _repr_html_inner(self) -> str:
        # scikit-learn's diagram of the settings stands below what was fitted with them
        settings = str(super()._repr_html_inner())
        is_fitted = "n_features_in_" in vars(self)
        return _fitted_html(self, self._draws()) + settings if is_fitted else settings

    def _repr_mimebundle_(self, **kwargs: Any) -> dict[str, str]:
        out = {"text/plain": repr(self)}
        if get_config()["display"] == "diagram":
            out["text/html"] = self._repr_html_inner()
        return out

    def __sklearn_tags__(self) -> Any:
        tags = super().__sklearn_tags__()
        # the score is a log density, not R^2
        tags.regressor_tags.poor_score = True
        return tags


def _spread_out(values: FloatArray, there: NDArray[np.bool_]) -> FloatArray:
    """Return values at the places where there are some, NaN elsewhere."""
    out = np.full(len(there), np.nan)
    out[there] = values
    return out
