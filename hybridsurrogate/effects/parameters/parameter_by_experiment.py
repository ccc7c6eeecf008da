"""A parameter that is not the same in all experiments."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from hybridsurrogate.effects.base import Cause, Context, Declared, FloatArray, Rows
from hybridsurrogate.effects.context import position_among
from hybridsurrogate.effects.expressions import Code, LevelTable
from hybridsurrogate.effects.registry import Form, register
from hybridsurrogate.exceptions import did_you_mean
from hybridsurrogate.priors import frozen, prior_sd
from hybridsurrogate.types import Prior

# an experiment that was not measured
_ANOTHER = "another"
# a search follows the experiments from a spread of so many prior standard deviations of the
# parameter: its sizes are those of every cause, and reach up to there
_WIDEST = 2.0


class ParameterByExperiment(Declared):
    """A parameter that differs between experiments: batches, subjects, sensors, sites.

    - ``how="spread"``: experiment e has ``parameter + spread u_e`` with u_e standard normal. The
      parameter is the population mean and ``spread`` the standard deviation between experiments.
      A priori the spread is half-Cauchy, its scale the parameter's prior standard deviation
      (Gelman 2006, Bayesian Analysis 1:515, section 7.1). Values beyond the support of the
      parameter's prior are set to its end;
    - ``how="own"``: each experiment has a separate value with the parameter's prior,
      independent of the others.

    An experiment that was not measured is drawn from the same distribution.

    Parameters
    ----------
    parameter : str
        A parameter of the simulation.
    column : str
        The measured column with the experiment of each row.
    how : {"spread", "own"}, default="spread"
    spread : frozen scipy.stats distribution, float or None, default=None
        Prior of the spread, or its value where it is known, in units of the parameter.
    prior : frozen scipy.stats distribution or None, default=None
        Of the parameter. None: as in the simulation.
    levels : tuple of float, default=()
        Values of the column. Empty: those of the measured rows, or 0, 1, ... of labels.
    labels : tuple of str or None, default=None
        What to call them. None: as they are.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> from scipy.stats import norm
    >>> rates = hs.ParameterByExperiment("rate", "batch", prior=norm(4, 1), levels=(1.0, 2.0))
    >>> theta = {"spread": 0.5, "batch = 1": -1.0, "batch = 2": 2.0, "another batch": 0.0}
    >>> theta = {name: np.full(3, value) for name, value in theta.items()}
    >>> rows = {"batch": np.array([1.0, 2.0, 7.0])}
    >>> _, omega = rates.inputs(rows, {"rate": np.full(3, 4.0)}, theta)
    >>> omega["rate"].tolist()
    [3.5, 5.0, 4.0]
    """

    kind = "parameter-by-experiment"
    about = "parameter"
    # one population, one size
    is_process = True

    def __init__(
        self,
        parameter: str,
        column: str,
        how: str = "spread",
        spread: Prior | float | None = None,
        prior: Prior | None = None,
        levels: tuple[float, ...] = (),
        labels: tuple[str, ...] | None = None,
    ):
        self.parameter = parameter
        self.column = column
        self.how = how
        self.spread = spread
        self.prior: Prior = prior
        self.levels = levels
        self.labels = labels

    @property
    def reads(self) -> tuple[str, ...]:
        """The column of the experiments."""
        return (self.column,)

    @property
    def variant(self) -> str:
        """Over which column."""
        return f"over {self.column}"

    @property
    def name(self) -> str:
        """The kind, the parameter and the column."""
        return f"{self.kind}({self.parameter} over {self.column})"

    def prepare(self, context: Context) -> Cause:
        """Fill in the experiments, and the priors."""
        if self.parameter not in context.parameters:
            raise ValueError(
                f"{self.parameter!r} is not a parameter of the simulation; these are: "
                f"{list(context.parameters)}.{did_you_mean(self.parameter, context.parameters)}"
            )
        if self.how not in ("spread", "own"):
            raise ValueError(f"how must be 'spread' or 'own', got {self.how!r}.")
        prior = self.prior or context.parameters[self.parameter]
        spread = self.spread
        if spread is None:
            spread = frozen(stats.halfcauchy, scale=prior_sd(prior))
        found = context.axis(self.column).rows.tolist()
        levels = self.levels or tuple(map(float, range(len(self.labels or ())))) or tuple(found)
        return self.filled(prior=prior, spread=spread, levels=levels)

    @property
    def _names(self) -> list[str]:
        """Names of the experiments' separate numbers."""
        labels = self.labels or tuple(f"{level:.12g}" for level in self.levels)
        return [f"{self.column} = {label}" for label in labels]

    def priors_by_name(self) -> Mapping[str, Prior]:
        """Return the priors of the spread, and of the experiments."""
        if self.how == "own":
            return dict.fromkeys(self._names, self.prior)
        unit = dict.fromkeys([*self._names, f"{_ANOTHER} {self.column}"], frozen(stats.norm))
        if isinstance(self.spread, float | int):
            return unit
        return {"spread": self.spread, **unit}

    @property
    def hierarchy(self) -> tuple[str, str, tuple[str, ...]] | None:  # type: ignore[override]
        """Mean, spread and deviations, where the spread is not known."""
        own = "spread" in self.parameters
        return (self.parameter, "spread", tuple(self._names)) if own else None

    def inputs(self, X: Rows, omega: Rows, theta: Rows) -> tuple[Rows, Rows]:
        """Give each row the parameter of its experiment."""
        mean, which = omega[self.parameter], position_among(self.levels, X[self.column])
        rest = mean if self.how == "own" else theta[f"{_ANOTHER} {self.column}"]
        each = np.stack([*(theta[name] for name in self._names), rest])
        own = each[which, np.arange(len(which))]
        if self.how == "spread":
            spread = theta.get("spread", self.spread)
            own = np.clip(mean + spread * own, *self.prior.support())
        return X, {**omega, self.parameter: own}

    def rows_of(self, X: Rows) -> dict[str, NDArray[np.bool_]]:
        """Return the rows of each experiment, and those of other experiments."""
        names = [*self._names, f"{_ANOTHER} {self.column}"]
        which = position_among(self.levels, X[self.column])
        return {name: which == k for k, name in enumerate(names) if name in self.parameters}

    def start(self) -> dict[str, float]:
        """Return experiments that are all the same."""
        return dict.fromkeys(self._names, 0.0) if "spread" in self.parameters else {}

    def grid(self) -> dict[str, FloatArray]:
        """Return one wide spread, from which the experiments are followed."""
        if "spread" not in self.parameters:
            return {}
        return {"spread": np.array([[0.0, 2 * _WIDEST * prior_sd(self.prior)]])}

    def estimates(self, theta: Rows, coefficients: Rows) -> dict[str, FloatArray]:
        """Return the spread, and how far each experiment is from their mean.

        Where each has a separate value, these values.
        """
        if self.how == "own":
            return {name: np.asarray(theta[name]) for name in self._names}
        first = np.asarray(theta[self._names[0]])
        spread = np.broadcast_to(np.asarray(theta.get("spread", self.spread)), first.shape)
        return {"spread": spread, **{name: spread * theta[name] for name in self._names}}

    def code(self) -> Code:
        """Return the cause as Python."""
        table = LevelTable(self.column, tuple(zip(self.levels, self._names, strict=True)), "{of}")
        at = {"x": self.column}
        if self.how == "own":
            own = "by_level({x}, {table}, {of})"
            return Code(own, {}, at, table=table, does="moves", of=self.parameter)
        own = "{of} + by_level({x}, {table})"
        # beyond the ends of its prior a parameter is at them
        ends = dict(zip(("low", "high"), map(float, self.prior.support()), strict=True))
        ends = {name: end for name, end in ends.items() if np.isfinite(end)}
        for name in ends:
            own = f"np.{'maximum' if name == 'low' else 'minimum'}({own}, {{{name}}})"
        return Code(own, {}, at, ends, table=table, does="moves", of=self.parameter)

    def formula(self, values: Mapping[str, float]) -> str:
        """Return the extended simulation in words."""
        if self.how == "own":
            return f"simulation with a separate {self.parameter} for each {self.column}"
        return (
            f"simulation with {self.parameter} differing between the values of {self.column} by "
            f"{values['spread']:.4g} (standard deviation)"
        )


def _between_experiments(context: Context) -> Iterator[Cause]:
    for column in context.labels:
        declared = column == context.experiment
        for parameter in context.parameters:
            if not declared or parameter not in context.by_experiment:
                labels = context.experiment_labels if declared else None
                yield ParameterByExperiment(parameter, column, labels=labels)


def _lacking(context: Context) -> Iterator[tuple[str | None, str]]:
    if not context.labels:
        yield (
            None,
            "no column labels experiments; experiment=... declares one",
        )


register(
    Form(
        "parameter-by-experiment",
        ParameterByExperiment,
        _between_experiments,
        meaning="the parameter {target} differs between the experiments of {column}",
        least_rows=6,
        least_distinct=2,
        lacking=_lacking,
        like=("missing-input",),
        headline="{target} differs between experiments, and the simulation has one value",
        call="`ParameterByExperiment(p, e)`",
        formula="eta(p + spread u_e)",
        priors="spread: half-Cauchy, prior sd of p; u_e: standard normal",
        estimates="spread, and how far each experiment is from the mean",
        left_out="no column of labels (declared, or 1, 2, 3 ...)",
    )
)
