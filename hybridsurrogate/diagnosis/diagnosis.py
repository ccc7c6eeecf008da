"""From measured data to a named cause, an extended model and its gain."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from numbers import Integral
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, RegressorMixin, clone
from sklearn.model_selection import KFold
from sklearn.utils import check_random_state, check_scalar
from sklearn.utils.validation import check_is_fitted

from hybridsurrogate.diagnosis.discrepancy import estimate_discrepancy, next_measurement
from hybridsurrogate.diagnosis.emulator_error import correct_emulator
from hybridsurrogate.diagnosis.evidence import Weighed, kind_of
from hybridsurrogate.diagnosis.extension import extend_simulator
from hybridsurrogate.diagnosis.forward import Step, forward_search
from hybridsurrogate.diagnosis.gain import Gain, cross_validated_gain, gain_from, pointwise
from hybridsurrogate.diagnosis.verdict import cause_table, credible_kinds, kind_shares
from hybridsurrogate.effects.base import Cause
from hybridsurrogate.effects.catalogue import Skipped, catalogue
from hybridsurrogate.estimators.power_scaled import PowerScaledSurrogate
from hybridsurrogate.estimators.problem import Problem, make_context, make_problem
from hybridsurrogate.exceptions import DiagnosisWarning, HybridSurrogateWarning
from hybridsurrogate.inference.linearised import Belief, coefficient_belief
from hybridsurrogate.likelihoods import TransformedNormal, as_likelihood
from hybridsurrogate.priors import FloatArray
from hybridsurrogate.simulation import SimulationData
from hybridsurrogate.surrogates.base import Basis

# one cause is "named" when it is three times as probable as all its rivals together
_NAMED = 0.75
_MIN_ROWS = 8
# enough for scores whose own standard error is that of a handful of rows
_FOLD_DRAWS = 400


@dataclass(frozen=True)
class CauseFinding:
    """What a diagnosis found.

    Attributes
    ----------
    kind : str
    target : str or None
        The input, parameter, constant or column concerned.
    formula : str
        The extended simulation in words, with numbers.
    probability : float
        Posterior probability of the cause.
    estimates : dict of str to (mean, low, high)
        With 90 % intervals, in the user's units.
    latex : str
        The formula in LaTeX.
    """

    kind: str
    target: str | None
    formula: str
    probability: float
    estimates: dict[str, tuple[float, float, float]]
    latex: str = r"\text{simulation}"


class DiscrepancyDiagnosis(RegressorMixin, BaseEstimator):
    """Find out what a simulation gets wrong, name the cause, extend the model, measure the gain.

    Parameters
    ----------
    estimator : PowerScaledSurrogate
        The model before, with its simulation; without effects.
    causes : sequence of Cause, default=()
        Mechanisms of your own, weighed beside the catalogue.
    false_alarm_rate : float, default=0.05
        The verdict is "adequate" unless the p-value of the whole search is at most this (and
        "none" has no more than half of the probability).
    n_replicates : int, default=200
        Replicated data sets for the p-value.
    cv : int or None, default=5
        Folds for ``gain_``; None: no cross-validation, ``gain_`` is None.
    max_causes : int, default=1
        How many causes are accepted, one after the other, each with the same control of false
        alarms.
    random_state : int, RandomState or None, default=None

    Attributes
    ----------
    estimator_ : PowerScaledSurrogate
        The model before, fitted.
    verdict_ : {"adequate", "named", "ambiguous", "unexplained"}
    p_value_ : float
        Of the whole search under "the simulation is right".
    causes_ : pandas.DataFrame
        Columns kind, target, probability, log_evidence (against "none"), remainder (probability
        that a smooth remainder is needed beside the cause), note; most probable first.
    best_cause_ : CauseFinding
    found_causes_ : list of CauseFinding
        Every accepted cause in the order in which it was found, ``best_cause_`` the first.
    indistinguishable_ : list of str
        Kinds that together reach 90 % probability, given that something is wrong.
    discrepancy_ : Discrepancy
    extended_estimator_ : PowerScaledSurrogate
        Fitted, with the cause as an effect; ``predict`` and ``score`` are its. The estimator
        before where the verdict is "adequate".
    extended_simulator_ : Simulator or None
        The simulation with the cause in it; None when there are only runs, or nothing to add.
    gain_ : Gain or None
        On held-out rows, the search repeated in each fold.
    next_measurement_ : dict of str to float
        Inputs at which one more measurement would best tell the rivals apart.
    search_ : Search
        All causes at their best, for plots.

    Examples
    --------
    >>> import hybridsurrogate as hs
    >>> from hybridsurrogate.datasets import make_log_sin
    >>> case = make_log_sin(random_state=0)
    >>> model = hs.PowerScaledSurrogate(
    ...     case.simulator, surrogate=hs.ExactSurrogate(), random_state=0)
    >>> diagnosis = hs.DiscrepancyDiagnosis(model, random_state=0).fit(case.X, case.y)
    >>> diagnosis.best_cause_.kind
    'periodic'
    """

    def __init__(
        self,
        estimator: PowerScaledSurrogate | None = None,
        causes: Sequence[Cause] = (),
        false_alarm_rate: float = 0.05,
        n_replicates: int = 200,
        cv: int | None = 5,
        max_causes: int = 1,
        random_state: Any = None,
    ):
        self.estimator = estimator
        self.causes = causes
        self.false_alarm_rate = false_alarm_rate
        self.n_replicates = n_replicates
        self.cv = cv
        self.max_causes = max_causes
        self.random_state = random_state

    # ---------------------------------------------------------------------------------- fit

    def fit(self, X: ArrayLike, y: ArrayLike) -> DiscrepancyDiagnosis:
        """Diagnose measured data.

        Parameters
        ----------
        X : array-like of shape (n, n_columns)
            May carry columns that the simulation ignores: by name (DataFrame) or after its inputs
            (array). They are weighed as missing inputs.
        y : array-like of shape (n,)

        Returns
        -------
        self
        """
        self._check_parameters()
        self._check_likelihood()
        random = check_random_state(self.random_state)
        self.estimator_ = clone(self.estimator).fit(X, y)
        problem, causes, skipped = self._problem(self.estimator_)
        basis, belief = self._emulator(problem)
        problem = _with_basis(problem, basis)
        if len(problem.y) < _MIN_ROWS:
            raise ValueError(
                f"A diagnosis needs at least {_MIN_ROWS} measured rows, got {len(problem.y)}."
            )
        steps = forward_search(
            problem,
            causes,
            belief,
            int(self.max_causes),
            self.false_alarm_rate,
            int(self.n_replicates),
            random,
        )
        first = steps[0]
        chosen = first.chosen
        self.search_, self.p_value_ = first.search, first.p_value
        self.causes_ = cause_table(self.search_, skipped)
        self.indistinguishable_ = credible_kinds(self.search_)
        self.verdict_ = self._verdict(chosen)
        accepted = _causes_of(steps)
        self.extended_estimator_ = self._extended(self.estimator_, accepted, X, y)
        self.found_causes_ = [self._finding(k, step) for k, step in enumerate(steps)]
        self.best_cause_ = self.found_causes_[0]
        self.extended_simulator_ = self._extended_simulator(problem, accepted)
        self.discrepancy_ = estimate_discrepancy(self.search_, self._column(chosen, problem))
        self.next_measurement_ = self._next_measurement(problem)
        self.gain_ = None
        if self.cv is not None:
            self.gain_ = self._cross_validate(X, np.asarray(y, dtype=float), random)
        self.n_features_in_ = self.estimator_.n_features_in_
        if hasattr(self.estimator_, "feature_names_in_"):
            self.feature_names_in_ = self.estimator_.feature_names_in_
        return self

    def _check_parameters(self) -> None:
        if not isinstance(self.estimator, PowerScaledSurrogate):
            raise TypeError(
                "estimator must be a PowerScaledSurrogate, whose effects a diagnosis can extend; "
                f"got {type(self.estimator).__name__}."
            )
        if self.estimator.simulation is None:
            raise ValueError(
                "There is no simulation to diagnose: give the estimator simulation=..."
            )
        if tuple(self.estimator.effects):
            raise ValueError(
                "The estimator has effects already. Diagnose the estimator without them: a cause "
                "found now is named beside the catalogue, not beside another cause."
            )
        check_scalar(self.max_causes, "max_causes", Integral, min_val=1)
        if not 0 < self.false_alarm_rate < 1:
            raise ValueError(f"false_alarm_rate must be in (0, 1), got {self.false_alarm_rate}.")
        if self.n_replicates < 1 / self.false_alarm_rate - 1:
            raise ValueError(
                f"n_replicates = {self.n_replicates} cannot give a p-value of "
                f"{self.false_alarm_rate}: use at least {int(1 / self.false_alarm_rate)}."
            )

    def _check_likelihood(self) -> None:
        assert self.estimator is not None
        likelihood = as_likelihood(self.estimator.likelihood)
        if not isinstance(likelihood, TransformedNormal):
            raise ValueError(
                "The diagnosis weighs causes in closed form, which needs a normal or log-normal "
                f"likelihood, not a {likelihood.name} one. For counts use likelihood='lognormal' "
                "on y + 1, measured and simulated."
            )

    def _problem(self, fitted: PowerScaledSurrogate) -> tuple[Problem, list[Cause], list[Skipped]]:
        """Return the problem, the catalogue and what was left out, for a fitted estimator."""
        surrogate, likelihood = fitted._check_parameters()
        X, y = fitted._measured
        columns = fitted.posterior_.model.columns
        problem = make_problem(
            fitted.simulation, surrogate, likelihood, fitted.noise_prior, (), columns, X, y
        )
        # a search over causes has no time to infer a surrogate's hyperparameters each time
        hyper = fitted.posterior_.values[:, fitted.posterior_.model.n_unknowns :]
        problem = problem.given(np.median(hyper, axis=0))
        context = make_context(
            fitted.simulation,
            columns,
            problem.model.n_inputs,
            X,
            problem.scale,
            likelihood,
            problem.model.basis,
        )
        causes, skipped = catalogue(context, tuple(self.causes))
        return problem, causes, skipped

    def _emulator(self, problem: Problem) -> tuple[Basis, Belief]:
        """Return the surrogate as the runs alone tell it, its own error corrected."""
        belief = coefficient_belief(problem.model.basis, problem.simulation)
        runs = self.estimator_.simulation
        if problem.simulation is None or not isinstance(runs, SimulationData):
            return problem.model.basis, belief
        run_eta = problem.likelihood.working(runs.y)
        return correct_emulator(problem.model.basis, belief, runs, run_eta)

    # ------------------------------------------------------------------------------ verdict

    def _verdict(self, chosen: Weighed) -> str:
        kind = kind_of(chosen)
        if kind == "none":
            return "adequate"
        if kind == "unexplained":
            return "unexplained"
        shares = kind_shares(self.search_)
        return "named" if shares[kind] >= _NAMED else "ambiguous"

    def _finding(self, position: int, step: Step) -> CauseFinding:
        chosen, found = step.chosen, step.search
        probability = float(found.probability[[w is chosen for w in found.weighed]].sum())
        if chosen.cause is None:
            return CauseFinding("none", None, "the simulation as it is", probability, {})
        draws = self.extended_estimator_.posterior_.estimates(position)
        estimates = {
            name: (float(v.mean()), float(np.quantile(v, 0.05)), float(np.quantile(v, 0.95)))
            for name, v in draws.items()
        }
        means = {name: value[0] for name, value in estimates.items()}
        return CauseFinding(
            chosen.cause.kind,
            chosen.cause.target,
            chosen.cause.formula(means),
            probability,
            estimates,
            chosen.cause.latex(means),
        )

    # ---------------------------------------------------------------------------- extension

    def _extended(
        self, before: PowerScaledSurrogate, causes: tuple[Cause, ...], X: ArrayLike, y: ArrayLike
    ) -> PowerScaledSurrogate:
        return clone(before).set_params(effects=causes).fit(X, y) if causes else before

    def _extended_simulator(self, problem: Problem, causes: tuple[Cause, ...]) -> Any:
        simulator = self.estimator_.simulation.simulator
        # what is inside the dynamics first, while they are seen; a factor acts on the simulation
        # alone, not on what other causes add to it
        ordered = sorted(
            causes, key=lambda cause: (cause.modification is None, not cause.touches_simulation)
        )
        changes = [c for c in ordered if c.kind != "unexplained" and c.changes_output]
        if simulator is None or not changes:
            return None
        for cause in changes:
            simulator = extend_simulator(simulator, cause, problem)
        return simulator

    def _column(self, chosen: Weighed, problem: Problem) -> str:
        inputs = problem.model.columns[: problem.model.n_inputs]
        column = getattr(chosen.cause, "column", None)
        return column if column in inputs else inputs[0]

    def _next_measurement(self, problem: Problem) -> dict[str, float]:
        """Search a grid over the simulated range of every input, one column at a time."""
        columns = problem.model.columns
        point = np.median(problem.X, axis=0)
        ranges = self.estimator_.simulation.input_ranges
        for k, name in enumerate(columns):
            low, high = ranges.get(name, (problem.X[:, k].min(), problem.X[:, k].max()))
            grid = np.repeat(point[None], 100, axis=0)
            grid[:, k] = np.linspace(low, high, 100)
            point = grid[int(np.argmax(next_measurement(self.search_, grid)))]
        return {name: float(value) for name, value in zip(columns, point, strict=True)}

    # --------------------------------------------------------------------------------- gain

    def _cross_validate(
        self, X: ArrayLike, y: FloatArray, random_state: np.random.RandomState
    ) -> Gain:
        """Repeat search and extension in each fold; selection is part of what is scored."""
        take = X.iloc.__getitem__ if hasattr(X, "iloc") else np.asarray(X).__getitem__

        def fit_pair(train: NDArray[np.intp]) -> tuple[Any, Any, str]:
            before = clone(self.estimator)
            before.set_params(n_draws=min(int(before.n_draws), _FOLD_DRAWS))
            before.fit(take(train), y[train])
            problem, causes, _ = self._problem(before)
            # emulator and belief come from the runs alone, which are the same in every fold
            problem = _with_basis(problem, self.search_.problem.model.basis)
            steps = forward_search(
                problem,
                causes,
                self.search_.belief,
                int(self.max_causes),
                self.false_alarm_rate,
                None,
                random_state,
                self.search_,
            )
            accepted = _causes_of(steps)
            after = self._extended(before, accepted, take(train), y[train])
            return before, after, kind_of(steps[0].chosen)

        n_folds = min(int(self.cv or 5), len(y) // 2)
        folds = list(KFold(n_folds, shuffle=True, random_state=random_state).split(y))
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", HybridSurrogateWarning)
            gain = cross_validated_gain(folds, fit_pair, take, y)
        doubtful = {str(w.message) for w in caught if "doubtful" in str(w.message)}
        if doubtful:
            warnings.warn(
                f"{len(doubtful)} of the fits behind gain_ have doubtful draws, for example: "
                f"{sorted(doubtful)[0]}",
                DiagnosisWarning,
                stacklevel=3,
            )
        return gain

    def gain_on(self, X_test: ArrayLike, y_test: ArrayLike) -> Gain:
        """Return the gain on a test set, from the fitted models before and after.

        Parameters
        ----------
        X_test : array-like of shape (n, n_columns)
        y_test : array-like of shape (n,)
        """
        check_is_fitted(self)
        y = np.asarray(y_test, dtype=float)
        return gain_from(
            pointwise(self.estimator_, X_test, y), pointwise(self.extended_estimator_, X_test, y)
        )

    def beta_scan(self, X: ArrayLike, y: ArrayLike, betas: ArrayLike | None = None) -> pd.DataFrame:
        """Return held-out ELPD against beta, before and after the extension.

        How far the best beta rises is how far trust in the simulation rises once its fault is
        named. Five folds, the cause held fixed.

        Parameters
        ----------
        X, y
            Measured data, as for ``fit``.
        betas : array-like, default=0, 0.1, ..., 1

        Returns
        -------
        pandas.DataFrame
            Columns beta, before, after.
        """
        check_is_fitted(self)
        y = np.asarray(y, dtype=float)
        take = X.iloc.__getitem__ if hasattr(X, "iloc") else np.asarray(X).__getitem__
        grid = np.linspace(0, 1, 11) if betas is None else np.asarray(betas, dtype=float)
        folds = list(KFold(min(5, len(y) // 2), shuffle=True, random_state=0).split(y))
        rows = []
        with warnings.catch_warnings():
            # single fits at extreme beta are often doubtful; the curve shows it
            warnings.simplefilter("ignore", HybridSurrogateWarning)
            for beta in grid:
                scores = []
                for model in (self.estimator_, self.extended_estimator_):
                    draws = min(int(model.n_draws), _FOLD_DRAWS)
                    fitted = clone(model).set_params(beta=float(beta), n_draws=draws)
                    scores.append(
                        np.concatenate(
                            [
                                fitted.fit(take(train), y[train]).log_predictive_density(
                                    take(test), y[test]
                                )
                                for train, test in folds
                            ]
                        ).mean()
                    )
                rows.append((beta, *scores))
        return pd.DataFrame(rows, columns=["beta", "before", "after"])

    # -------------------------------------------------------------------------- predictions

    def predict(self, X: ArrayLike, return_std: bool = False) -> Any:
        """Return predictions of the extended estimator."""
        check_is_fitted(self)
        return self.extended_estimator_.predict(X, return_std=return_std)

    def score(self, X: ArrayLike, y: ArrayLike, sample_weight: ArrayLike | None = None) -> float:
        """Return the mean ELPD per row of the extended estimator."""
        check_is_fitted(self)
        return self.extended_estimator_.score(X, y, sample_weight)

    def report(self, test: tuple[ArrayLike, ArrayLike] | None = None) -> Any:
        """Return the report: prints as text, shows as HTML, ``.save("report.html")``.

        Parameters
        ----------
        test : (X_test, y_test) or None
            Rows held back, for example beyond the measured range, to be drawn and scored too.
        """
        check_is_fitted(self)
        from .report import make_report

        return make_report(self, test)


def _with_basis(problem: Problem, basis: Basis) -> Problem:
    return replace(problem, model=replace(problem.model, basis=basis))


def _causes_of(steps: Sequence[Step]) -> tuple[Cause, ...]:
    return tuple(step.chosen.cause for step in steps if step.found and step.chosen.cause)
