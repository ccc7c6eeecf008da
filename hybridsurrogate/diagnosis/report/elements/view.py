"""A result as its report needs it: the column that matters, predictions, residuals, units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import special

from hybridsurrogate.arguments import check_units
from hybridsurrogate.diagnosis.fitting.result import DiagnosisResult
from hybridsurrogate.diagnosis.search.candidate import MIN_PROBABILITY, Candidate
from hybridsurrogate.diagnosis.search.search import Search, predict_locally
from hybridsurrogate.diagnosis.validation.refit import added_causes
from hybridsurrogate.effects.base import Cause
from hybridsurrogate.estimators.averaged import AveragedSurrogate, leading
from hybridsurrogate.estimators.power_scaled import PowerScaledSurrogate
from hybridsurrogate.likelihoods import Censored
from hybridsurrogate.model.rows.stacking import Stacking
from hybridsurrogate.numerics import digits
from hybridsurrogate.plotting import Prediction
from hybridsurrogate.simulation.outputs import OUTPUT
from hybridsurrogate.simulation.variables import MAX_LEVELS
from hybridsurrogate.types import FloatArray

if TYPE_CHECKING:
    from hybridsurrogate.diagnosis.answers.discrepancy import Discrepancy
    from hybridsurrogate.diagnosis.answers.finding import CauseFinding


@dataclass(frozen=True)
class ReportSettings:
    """Numbers of the report.

    Attributes
    ----------
    min_information : float
        Expected information in bits below which one more measurement is hardly worth it.
    max_listed : int
        Things that a sentence lists.
    max_causes : int
        Causes in the table and in the picture, at most.
    as_probable : float
        A form of the same kind with more than this share of the cause's probability may be it as
        well.
    """

    min_information: float = 0.07
    max_listed: int = 4
    max_causes: int = 8
    as_probable: float = 0.25


SETTINGS = ReportSettings()


@dataclass(frozen=True)
class View:
    """What a fit found, seen as a report needs it; rows have the simulation's inputs first.

    Attributes
    ----------
    result : DiagnosisResult
    position : int
        Which of several outputs is looked at.
    units : dict of str to str
        Units of columns, outputs, parameters and constants, as far as they are given.
    """

    result: DiagnosisResult
    position: int = 0
    units: Mapping[str, str] = field(default_factory=dict)

    @property
    def stacking(self) -> Stacking | None:
        """How several outputs are laid out, None of a single one."""
        return self.result.search.problem.stacking

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of all outputs."""
        return self.result.before.simulation.outputs

    def of(self, output: str) -> View:
        """Return the view of another output."""
        return View(self.result, self.outputs.index(output), self.units)

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the measured columns, the simulation's inputs first."""
        names = self.result.search.problem.model.columns
        return tuple(name for name in names if name != OUTPUT)

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the simulation's inputs."""
        return self.result.before.simulation.input_names

    @cached_property
    def _there(self) -> NDArray[np.bool_]:
        """Which rows have this output."""
        y = self.result.before.measured_[1]
        return np.isfinite(y if self.stacking is None else y[:, self.position])

    @property
    def X(self) -> FloatArray:
        """Measured rows."""
        return self.result.before.measured_[0][self._there]

    @property
    def y(self) -> FloatArray:
        """Measured outputs."""
        return self.of_output(self.result.before.measured_[1])[self._there]

    @property
    def y_err(self) -> FloatArray | None:
        """Known errors of the measured outputs, None without any."""
        errors = self.result.rows.y_err
        if errors is None:
            return None
        if np.ndim(errors) > 2:
            errors = np.sqrt(np.diagonal(errors, axis1=1, axis2=2))
        return self.of_output(errors)[self._there]

    @property
    def side(self) -> NDArray[np.int_] | None:
        """Of measured outputs -1 where one is at a lower limit, 1 at an upper; None: no limits."""
        likelihood = self.result.before.likelihood_
        return likelihood.side(self.y) if isinstance(likelihood, Censored) else None

    def of_output(self, values: FloatArray) -> FloatArray:
        """Return the values of this output, of (n,) or (n, k)."""
        return values if self.stacking is None else values[:, self.position]

    def single(self, X: FloatArray) -> FloatArray:
        """Return rows as models see them: of several outputs with the one that is looked at."""
        if self.stacking is None:
            return X
        return np.insert(X, self.stacking.at, float(self.position), axis=1)

    @property
    def unit(self) -> float:
        """What outputs of models are multiplied by."""
        return 1.0 if self.stacking is None else float(self.stacking.scale[self.position])

    @property
    def output(self) -> str:
        """Name of the output."""
        return self.outputs[self.position]

    def unit_of(self, name: str) -> str:
        """Return the unit of a column, output or parameter; its name where none is given."""
        return self.units.get(name, name)

    @property
    def labels(self) -> Mapping[str, tuple[str, ...]]:
        """Names in columns of text, which rows number from zero."""
        return self.result.before.data_.experiments.labels

    def value(self, name: str, value: float) -> str:
        """Return a value of a column as text, of a column of names the name."""
        return self.labels[name][int(value)] if name in self.labels else digits.number(value)

    def axis(self, name: str) -> str:
        """Return the label of an axis."""
        return f"{name} ({self.units[name]})" if name in self.units else name

    @property
    def scale(self) -> str:
        """The unit of what is added to the output: on a logarithmic scale that of its log."""
        return f"log {self.output}" if self.log_scale else self.unit_of(self.output)

    def amount(self, value: float) -> str:
        """Return a difference of the output with its unit, where one is given."""
        text = digits.number(value, 2)
        if self.log_scale:
            return f"{text} in log {self.output}"
        return f"{text} {self.units[self.output]}" if self.output in self.units else text

    @property
    def band(self) -> Discrepancy:
        """The smooth discrepancy of the output."""
        return self.result.extension.discrepancies[self.output]

    @property
    def band_x(self) -> FloatArray:
        """The places of the smooth discrepancy on its column."""
        return self.band.grid[:, self.columns.index(self.band.column)]

    def noise(self, model: Any) -> float:
        """Return the mean of the noise of the output in a fitted model, in its units."""
        return float(np.mean(self.noise_draws(model)))

    def noise_draws(self, model: Any) -> FloatArray:
        """Return draws of the noise of the output in a fitted model, in its units."""
        return np.asarray(self.unit * model.posterior_.noise_of(self.output, self.position))

    @property
    def log_scale(self) -> bool:
        """Whether causes act on the logarithm of the output."""
        return bool(self.result.search.problem.likelihood.log_scale)

    @property
    def log(self) -> str:
        """What stands before "measured" where the difference of logarithms is meant."""
        return "log " if self.log_scale else ""

    @property
    def extended(self) -> bool:
        """Whether there is a model after, other than the one before."""
        return self.result.extension.estimator is not self.result.before

    @property
    def found(self) -> PowerScaledSurrogate:
        """The model with the accepted causes, first of those that are averaged."""
        return leading(self.result.extension.estimator)

    @property
    def models(self) -> dict[str, PowerScaledSurrogate]:
        """The fitted models before and, where something was added, after, without averages."""
        before = {"simulation": self.result.before}
        return before | {"extended model": self.found} if self.extended else before

    @property
    def cause(self) -> Cause | None:
        """The first accepted cause, prepared, as its search knows it."""
        return self.result.steps[0].chosen.cause if self.extended else None

    @property
    def search(self) -> Search:
        """The search for the first cause, conditional on all other accepted causes."""
        return self.result.steps[0].conditional

    @property
    def findings(self) -> list[tuple[CauseFinding, Cause]]:
        """Every accepted cause, its finding and the cause itself, in order."""
        if not self.extended:
            return []
        causes = [step.chosen.cause for step in self.result.steps]
        found = zip(self.result.extension.found_causes, causes, strict=True)
        return [(finding, cause) for finding, cause in found if cause is not None]

    @cached_property
    def before(self) -> FloatArray:
        """Predictions at the measured rows before the extension."""
        return self.predicted(self.result.before, self.X)

    @cached_property
    def after(self) -> FloatArray:
        """Predictions at the measured rows after the extension."""
        return self.predicted(self.result.extension.estimator, self.X)

    def predicted(self, model: Any, X: FloatArray) -> FloatArray:
        """Return the predictions of the output at rows."""
        return self.of_output(np.asarray(model.predict(self._as_given(X))))

    def prediction(self, model: Any, X: FloatArray) -> Prediction:
        """Return mean and central intervals of a fitted model at rows."""
        rows = self._as_given(X)
        values = [model.predict(rows), *model.predict_interval(rows, 0.5)]
        values += model.predict_interval(rows, 0.9)
        return Prediction(*map(self.of_output, values))

    @cached_property
    def change(self) -> FloatArray:
        """What accepted causes add to the predictions at the measured rows, on the scale of eta.

        In units of an output of several decades it would be large where the output is.
        """
        return self.working_residuals(self.result.before) - self.working_residuals(self.found)

    @cached_property
    def shown(self) -> int:
        """Position of the column over which pictures are drawn: that of the cause, if any.

        Else the input over which the change, or without a cause the prediction, varies most.
        """
        varying = [k for k in range(len(self.columns)) if np.ptp(self.X[:, k]) > 0]
        for name in self.cause.reads if self.cause is not None else ():
            if name in self.columns and self.columns.index(name) in varying:
                return self.columns.index(name)
        among = [k for k in varying if k < len(self.inputs)] or [0]
        curve = self.change if self.extended and np.ptp(self.change) > 0 else self.before
        return max(among, key=lambda k: _explained(self.X[:, k], curve))

    @property
    def name(self) -> str:
        """Name of the column over which pictures are drawn."""
        return self.columns[self.shown]

    @property
    def x(self) -> FloatArray:
        """Its measured values."""
        return self.X[:, self.shown]

    @property
    def is_curve(self) -> bool:
        """Whether predictions are a curve over the one column there is."""
        return len(self.columns) == 1

    def _as_given(self, X: FloatArray) -> Any:
        """Return rows whose simulation inputs come first as the user's columns."""
        estimator = self.result.before
        rows = np.empty_like(X)
        rows[:, estimator.data_.order] = X
        names = getattr(estimator, "feature_names_in_", None)
        return rows if names is None else pd.DataFrame(rows, columns=names)

    def held_back(self, test: tuple[Any, Any]) -> tuple[FloatArray, FloatArray]:
        """Return held-out rows, the simulation's inputs first, and their outputs."""
        model = self.result.before
        rows = model.checked_rows(test[0])
        if self.stacking is not None:
            rows = np.delete(rows[:: len(self.outputs)], self.stacking.at, axis=1)
        y = self.of_output(np.asarray(test[1], dtype=float))
        return rows[np.isfinite(y)], y[np.isfinite(y)]

    def grid(
        self, low: float, high: float, at: FloatArray | None = None, n: int = 400
    ) -> FloatArray:
        """Return rows that vary the shown column, the others at their medians or at one row."""
        known = np.unique(self.x)
        few = self.name not in self.inputs and len(known) <= MAX_LEVELS
        # between its few values a column such as a batch means nothing
        values = known if few else np.linspace(low, high, n)
        row = np.median(self.X, axis=0) if at is None else at
        rows = np.repeat(row[None], len(values), axis=0)
        rows[:, self.shown] = values
        return rows

    @property
    def candidates(self) -> list[tuple[Candidate, float]]:
        """All causes that were compared, with their probabilities, most probable first."""
        return _ranked(self.search)

    def alternatives(self, result: Search) -> list[Candidate]:
        """Return the most probable explanations, at least two where there are two."""
        return [
            candidate
            for place, (candidate, p) in enumerate(_ranked(result)[: SETTINGS.max_listed])
            if place < 2 or p > MIN_PROBABILITY
        ]

    def other_forms(self) -> list[Candidate]:
        """Return other forms of the named kind that are about as probable as the cause."""
        if self.cause is None:
            return []
        cause, own = self.cause, self.own_probability
        return [
            w
            for w, p in self.candidates
            if w.kind == cause.kind and w.cause is not cause and p > SETTINGS.as_probable * own
        ]

    @property
    def own_probability(self) -> float:
        """The probability of the first cause in its form."""
        return next(p for w, p in self.candidates if w.cause is self.cause)

    def expected(self, result: Search, candidate: Candidate, X: FloatArray) -> FloatArray:
        """Return what an explanation predicts at rows, in units of the output."""
        eta = predict_locally(result, candidate, self.single(X))[0]
        return self.unit * result.problem.likelihood.inverse(eta)

    def standardised(self, model: Any) -> FloatArray:
        """Return residuals at the measured rows that are standard normal if the model is right."""
        return self._residuals[id(model)][1]

    def working_residuals(self, model: Any) -> FloatArray:
        """Return measured minus predicted at the measured rows, on the scale of eta."""
        return self._residuals[id(model)][0]

    @cached_property
    def _residuals(self) -> dict[int, tuple[FloatArray, FloatArray]]:
        """Residuals of either model on the scale of eta, and standardised, both from one eta."""
        rows, y = self.single(self.X), self.y / self.unit
        found = {id(model): _residuals_of(model, rows, y) for model in self.models.values()}
        # what is divided by a scale is not on a logarithmic one
        return {key: (self.unit * working, z) for key, (working, z) in found.items()}


def view_of(result: DiagnosisResult, units: Mapping[str, str] | None = None) -> View:
    """Return a result as a report sees it first: the output that the first cause concerns.

    Of a cause in all outputs that which it changes most, in units of its noise.

    Raises
    ------
    ValueError
        For units of what is no column, output, parameter or constant.
    TypeError
        For units that are no dict of text.
    """
    view, simulation = View(result), result.before.simulation
    known = [*view.columns, *view.outputs, *simulation.parameter_names, *simulation.assumed_names]
    view = replace(view, units=check_units(units, known))
    if view.stacking is None:
        return view
    if view.cause is not None and view.cause.output is not None:
        return view.of(view.cause.output)
    views = [view.of(name) for name in view.outputs]

    def moved(one: View) -> float:
        return float(np.mean(one.change**2)) / one.noise(view.found) ** 2

    return max(views, key=moved) if view.extended else view


def _residuals_of(model: Any, X: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return residuals on the scale of eta, and standard normal ones if the model is right.

    Where y is not normal the latter are from the share of simulated measurements below it and half
    of those that are equal (Dunn and Smyth 1996, J. Comput. Graph. Stat. 5:236).
    """
    eta, noise = model.posterior_.eta(X)
    likelihood = model.posterior_.likelihood
    working = likelihood.working(y)
    if likelihood.gaussian:
        below = np.mean(special.ndtr((working - eta) / noise), axis=0)
    else:
        drawn = likelihood.sample(eta, noise, np.random.RandomState(0))
        below = np.mean(drawn < y, axis=0) + 0.5 * np.mean(drawn == y, axis=0)
    return working - eta.mean(axis=0), special.ndtri(np.clip(below, 1e-9, 1 - 1e-9))


def label(kind: str, target: str | None, variant: str = "") -> str:
    """Return how a report calls a cause: "step in year", "trend in t (quadratic)"."""
    if kind in _WORDS:
        return _WORDS[kind]
    of = "of" if kind in _OF else "in"
    name = f"{kind} {of} {target}" if target else kind
    return f"{name} ({variant})" if variant else name


_WORDS = {"none": "nothing is wrong", "unexplained": "a smooth curve, cause unknown"}
_OF = ("wrong-constant", "parameter-drift", "interaction", "missing-term")


def label_of_cause(cause: Cause | None) -> str:
    """Return how a report calls a cause, None for nothing wrong."""
    if cause is None:
        return label("none", None)
    inner = cause.inner
    text = label(inner.kind, inner.target, inner.variant)
    return text if cause.output is None else f"{text}, output {cause.output}"


def label_of(candidate: Candidate) -> str:
    """Return how a report calls one explanation of a search."""
    if candidate.cause is None and candidate.fit.model.effects:
        return "nothing further is wrong"
    return label_of_cause(candidate.cause)


def averaged(view: View) -> list[tuple[PowerScaledSurrogate, str, float]]:
    """Return what the extended model averages over: each model, its causes and its weight."""
    after = view.result.extension.estimator
    if not isinstance(after, AveragedSurrogate):
        return []
    causes = [added_causes(one, view.result.before) for one in after.estimators_]
    labels = [
        " and ".join(map(label_of_cause, each)) if each else label_of_cause(None) for each in causes
    ]
    return list(zip(after.estimators_, labels, after.weights_.tolist(), strict=True))


def _ranked(result: Search) -> list[tuple[Candidate, float]]:
    order = np.argsort(-result.probability, kind="stable")
    return [(result.candidates[k], float(result.probability[k])) for k in order]


def root_mean_square(values: FloatArray) -> float:
    """Return the size of residuals or of changes."""
    return float(np.sqrt(np.mean(values**2)))


def _explained(x: FloatArray, curve: FloatArray) -> float:
    """Return the spread of a curve's mean over bins of a column with equally many rows."""
    order = np.argsort(x, kind="stable")
    # five bins at most
    parts = np.array_split(curve[order], min(5, len(curve)))
    return float(np.std([part.mean() for part in parts]))
