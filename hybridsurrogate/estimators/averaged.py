"""Several explanations at once: predictions averaged over estimators."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from sklearn.base import clone
from sklearn.utils.validation import check_is_fitted

from hybridsurrogate.arguments import described
from hybridsurrogate.effects.base import Cause
from hybridsurrogate.effects.output.processes import is_beyond
from hybridsurrogate.estimators.base import SurrogateEstimator
from hybridsurrogate.estimators.power_scaled import PowerScaledSurrogate, as_causes
from hybridsurrogate.exceptions import SamplingWarning
from hybridsurrogate.inference.loo import PointwiseLoo
from hybridsurrogate.likelihoods import as_likelihood
from hybridsurrogate.model.posterior import Diagnostics, Posterior
from hybridsurrogate.prediction.leave_one_out import loo_of_mixture
from hybridsurrogate.prediction.variables import MixturePart
from hybridsurrogate.simulation.arrays import as_numbers
from hybridsurrogate.simulation.simulator import SimulationData, Simulator
from hybridsurrogate.types import FloatArray

# doubtful draws of estimators with no more than this share of the weight make no doubtful average
_MAX_DOUBTFUL_SHARE = 0.1


class AveragedSurrogate(SurrogateEstimator):
    """Mixture of several extensions of one model, with fixed weights.

    With the probabilities of the explanations as weights this is Bayesian model averaging (Hoeting,
    Madigan, Raftery and Volinsky 1999, Statistical Science 14:382). Predictions are wider where
    explanations differ, as they do beyond the data.

    Parameters
    ----------
    estimators : sequence of PowerScaledSurrogate
        Of the same simulation and likelihood, for example with different effects.
    weights : sequence of float
        One for each; they are scaled to sum to one.
    random_state : int, RandomState or None, default=None
        For draws from the fitted model; each estimator is fitted with its own.
    beyond : PowerScaledSurrogate or None, default=None
        Predicts rows beyond the measured range, which a `Remainder` knows, in place of estimators
        that add no more to it than curves of any shape: where these go nobody knows.

    Attributes
    ----------
    estimators_ : list of PowerScaledSurrogate
        Fitted.
    weights_ : ndarray of shape (n_estimators,)
    beyond_ : PowerScaledSurrogate or None
        Fitted.
    posterior_, diagnostics_, effects
        Of the first estimator: draws of models that differ have no average.

    Warns
    -----
    SamplingWarning
        Where draws are unreliable for more than a tenth of the weight. The ``diagnostics_`` of each
        estimator have the problems at any weight.

    Examples
    --------
    >>> import hybridsurrogate as hs
    >>> from hybridsurrogate.datasets import make_log_sin
    >>> case = make_log_sin(random_state=0)
    >>> models = [
    ...     hs.PowerScaledSurrogate(case.simulation, effects=[effect], random_state=0)
    ...     for effect in (hs.Offset(), hs.Trend("x"))]
    >>> model = hs.AveragedSurrogate(models, [0.7, 0.3], random_state=0).fit(case.X, case.y)
    >>> model.predict(case.X_in).shape
    (100,)
    """

    def __init__(
        self,
        estimators: Sequence[PowerScaledSurrogate] = (),
        weights: Sequence[float] = (),
        random_state: Any = None,
        beyond: PowerScaledSurrogate | None = None,
    ):
        self.estimators = estimators
        self.weights = weights
        self.random_state = random_state
        self.beyond = beyond

    def __repr__(self, N_CHAR_MAX: int = 400) -> str:
        # several models with their effects, indented: scikit-learn counts no blanks
        return super().__repr__(N_CHAR_MAX)

    @property
    def simulation(self) -> SimulationData | Simulator | None:
        """The simulation that the estimators share; None without any."""
        return self.estimators[0].simulation if self.estimators else None

    @property
    def experiment(self) -> str | None:  # type: ignore[override]
        """The column of experiments that the estimators share."""
        return self.estimators[0].experiment if self.estimators else None

    @property
    def by_experiment(self) -> Mapping[str, str] | None:  # type: ignore[override]
        """What differs between experiments in the first estimator."""
        return self.estimators[0].by_experiment if self.estimators else None

    def fit(
        self,
        X: ArrayLike,
        y: ArrayLike,
        sample_weight: ArrayLike | None = None,
        y_err: Any = None,
    ) -> AveragedSurrogate:
        """Fit every estimator to measured data.

        Parameters
        ----------
        X : array-like of shape (n, n_columns)
        y : array-like of shape (n,)
        sample_weight : array-like of shape (n,) or None, default=None
            A row of weight two counts like two equal rows.
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

        Raises
        ------
        TypeError
            For anything but estimators with one posterior each.
        ValueError
            For no estimators, other simulations or likelihoods, or weights that do not fit.
        """
        weights = self._checked_weights()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SamplingWarning)
            fitted = [clone(one).fit(X, y, sample_weight, y_err) for one in self._all()]
        self._keep(fitted, weights)
        self._warn(self.weights_, self.estimators_)
        return self

    def _all(self) -> list[PowerScaledSurrogate]:
        """Return the estimators, and last the one for rows beyond the measured range."""
        return [*self.estimators, *([] if self.beyond is None else [self.beyond])]

    @classmethod
    def of_fitted(
        cls,
        estimators: Sequence[PowerScaledSurrogate],
        weights: Sequence[float],
        random_state: Any = None,
        beyond: PowerScaledSurrogate | None = None,
    ) -> AveragedSurrogate:
        """Return the average over estimators that are fitted, to the same rows.

        Draws that are unreliable cause no second warning.

        Parameters
        ----------
        estimators : sequence of PowerScaledSurrogate
        weights : sequence of float
        random_state : int, RandomState or None, default=None
        beyond : PowerScaledSurrogate or None, default=None

        Raises
        ------
        TypeError, ValueError
            As by ``fit``, and for estimators that were fitted to other rows.

        Examples
        --------
        >>> import hybridsurrogate as hs
        >>> from hybridsurrogate.datasets import make_log_sin
        >>> case = make_log_sin(random_state=0)
        >>> fitted = [
        ...     hs.PowerScaledSurrogate(case.simulation, beta=beta, random_state=0)
        ...     .fit(case.X, case.y) for beta in (0.3, 0.7)]
        >>> hs.AveragedSurrogate.of_fitted(fitted, [0.5, 0.5]).predict(case.X_in).shape
        (100,)
        """
        last = None if beyond is None else clone(beyond)
        average = cls([clone(one) for one in estimators], weights, random_state, last)
        checked = average._checked_weights()
        fitted = [*estimators, *([] if beyond is None else [beyond])]
        for one in fitted:
            check_is_fitted(one)
            for mine, first in zip(one.measured_, estimators[0].measured_, strict=True):
                if not np.array_equal(mine, first, equal_nan=True):
                    raise ValueError("All estimators must be fitted to the same measured rows.")
        return average._keep(fitted, checked)

    def _keep(self, fitted: list[PowerScaledSurrogate], weights: FloatArray) -> AveragedSurrogate:
        self._store(fitted[0].data_)
        self.emulation_ = fitted[0].emulation_
        self.estimators_, self.weights_ = fitted[: len(weights)], weights / weights.sum()
        self.beyond_ = None if self.beyond is None else fitted[-1]
        return self

    @property
    def posterior_(self) -> Posterior:
        """Draws of the first estimator, which are not averaged."""
        return self._fitted_first().posterior_

    @property
    def diagnostics_(self) -> Diagnostics:
        """Diagnostics of the draws of the first estimator."""
        return self._fitted_first().diagnostics_

    @property
    def effects(self) -> tuple[Cause, ...]:
        """The effects of the first estimator."""
        return tuple(self._fitted_first().effects)

    def _fitted_first(self) -> PowerScaledSurrogate:
        # before a fit these are attributes that are not there yet, as everywhere
        if "estimators_" not in vars(self):
            raise AttributeError("This AveragedSurrogate is not fitted yet.")
        return self.estimators_[0]

    @staticmethod
    def _warn(weights: FloatArray, fitted: Sequence[PowerScaledSurrogate]) -> None:
        """Warn where draws are doubtful for more than a tenth of the weight."""
        problems = [one.diagnostics_.problems() for one in fitted]
        doubtful = np.array([bool(found) for found in problems])
        share = float(weights[doubtful].sum())
        if share > _MAX_DOUBTFUL_SHARE:
            worst = int(np.argmax(weights * doubtful))
            warnings.warn(
                f"The draws of {doubtful.sum()} of {len(doubtful)} estimators, with "
                f"{100 * share:.0f} % of the weight, are doubtful; of estimator {worst}: "
                f"{'; '.join(problems[worst])}. Try more n_draws or tighter priors.",
                SamplingWarning,
                stacklevel=3,
            )

    def _checked_weights(self) -> FloatArray:
        if not isinstance(self.estimators, list | tuple):
            raise TypeError(
                "estimators must be a list of PowerScaledSurrogate objects, got "
                f"{described(self.estimators)}."
            )
        if not self.estimators:
            raise ValueError("estimators must hold at least one estimator, got none.")
        first = self.estimators[0]
        for one in self._all():
            if not isinstance(one, PowerScaledSurrogate):
                raise TypeError(f"estimators must hold PowerScaledSurrogate objects, got {one!r}.")
            alike = as_likelihood(one.likelihood) == as_likelihood(first.likelihood)
            alike &= one.experiment == first.experiment
            if one.simulation is not first.simulation or not alike:
                raise ValueError(
                    "All estimators must have the same simulation object, the same likelihood and "
                    "the same experiment: their predictions are averaged over one set of columns, "
                    "for one output."
                )
        weights = as_numbers(self.weights, "weights")
        if weights.shape != (len(self.estimators),):
            raise ValueError(
                f"weights must hold one number for each of the {len(self.estimators)} estimators, "
                f"got shape {weights.shape}."
            )
        if not (weights >= 0).all() or not 0 < weights.sum() < np.inf:
            raise ValueError(
                f"weights must not be negative or NaN, and their sum must be positive, got "
                f"{weights.tolist()}."
            )
        return weights

    def _weighted(self) -> list[tuple[float, PowerScaledSurrogate]]:
        """Return the estimators that have a weight, after it."""
        pairs = zip(self.weights_.tolist(), self.estimators_, strict=True)
        return [(weight, one) for weight, one in pairs if weight > 0]

    def _mixture(self, X: FloatArray | None = None) -> list[tuple[Any, Posterior]]:
        return self._handed_over(X, lambda one: one.posterior_)

    def _learned(self, X: FloatArray | None = None) -> list[tuple[Any, Posterior]]:
        return self._handed_over(X, lambda one: one.inference_.second)

    def _handed_over(
        self, X: FloatArray | None, draws: Callable[[PowerScaledSurrogate], Posterior]
    ) -> list[tuple[Any, Posterior]]:
        """Return draws with weights; of curves beyond the measured range another one has theirs."""
        pairs: list[tuple[Any, Posterior]] = []
        handed: Any = 0.0
        for weight, one in self._weighted():
            model = one.posterior_.model
            share: Any = weight
            if X is not None and self._is_curve(one):
                beyond = is_beyond(model.effects, dict(zip(model.columns, X.T, strict=False)))
                if beyond.any():
                    share, handed = weight * ~beyond, handed + weight * beyond
            pairs.append((share, draws(one)))
        if self.beyond_ is not None and np.any(handed):
            pairs.append((handed, draws(self.beyond_)))
        return pairs

    def _is_curve(self, one: PowerScaledSurrogate) -> bool:
        """Whether an estimator adds smooth curves to that beyond the range, and no more."""
        if self.beyond_ is None:
            return False
        further = as_causes(one.effects)[len(as_causes(self.beyond_.effects)) :]
        added = [effect for effect in further if effect.is_learned]
        return bool(added) and all(effect.is_smooth_curve for effect in added)

    def _parts(self) -> list[MixturePart]:
        return [
            part._replace(weight=weight)
            for weight, one in self._weighted()
            for part in one._parts()
        ]

    def _draws(self) -> list[tuple[str, Any, Posterior, Diagnostics]]:
        out = []
        for weight, one in zip(self.weights_, self.estimators_, strict=True):
            causes = " + ".join(effect.name for effect in one.posterior_.model.effects) or "none"
            out.append((causes, float(weight), one.posterior_, one.diagnostics_))
        return out

    def _pointwise_loo(self, progress: bool = False) -> PointwiseLoo:
        parts = [one._pointwise_loo(progress) for one in self.estimators_]
        return loo_of_mixture(parts, self.weights_)


def leading(estimator: PowerScaledSurrogate | AveragedSurrogate) -> PowerScaledSurrogate:
    """Return the first of the estimators that are averaged, or the only one.

    Parameters
    ----------
    estimator : PowerScaledSurrogate or AveragedSurrogate
        Fitted.
    """
    return estimator.estimators_[0] if isinstance(estimator, AveragedSurrogate) else estimator
