"""A parameter that is not the same in all experiments."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy import stats

from hybridsurrogate.effects.base import Cause, Context, FloatArray, Rows
from hybridsurrogate.effects.expressions import Code, LevelTable
from hybridsurrogate.effects.over_column import OverExperiments
from hybridsurrogate.effects.registry import WITHOUT_LABELS, Form, register
from hybridsurrogate.priors import frozen, prior_sd
from hybridsurrogate.types import Prior


@dataclass(eq=False, repr=False)
class ParameterByExperiment(OverExperiments):
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

    parameter: str
    column: str
    how: str = "spread"
    spread: Prior | float | None = None
    prior: Prior = None
    levels: tuple[float, ...] = ()
    labels: tuple[str, ...] | None = None

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
        given = context.parameter(self.parameter)
        if self.how not in ("spread", "own"):
            raise ValueError(f"how must be 'spread' or 'own', got {self.how!r}.")
        prior = self.prior or given
        spread = self.spread
        if spread is None:
            spread = frozen(stats.halfcauchy, scale=prior_sd(prior))
        return self.filled(prior=prior, spread=spread, levels=self.levels_in(context))

    def priors_by_name(self) -> Mapping[str, Prior]:
        """Return the priors of the spread, and of the experiments."""
        if self.how == "own":
            return dict.fromkeys(self.names_of_levels, self.prior)
        unit = dict.fromkeys([*self.names_of_levels, self.another], frozen(stats.norm))
        if isinstance(self.spread, float | int):
            return unit
        return {"spread": self.spread, **unit}

    @property
    def hierarchy(self) -> tuple[str, str, tuple[str, ...]] | None:  # type: ignore[override]
        """Mean, spread and deviations, where the spread is not known."""
        own = "spread" in self.parameters
        return (self.parameter, "spread", tuple(self.names_of_levels)) if own else None

    def inputs(self, X: Rows, omega: Rows, theta: Rows) -> tuple[Rows, Rows]:
        """Give each row the parameter of its experiment."""
        mean = omega[self.parameter]
        rest = mean if self.how == "own" else theta[self.another]
        own = self.each_row(X, [*(theta[name] for name in self.names_of_levels), rest])
        if self.how == "spread":
            spread = np.asarray(theta.get("spread", self.spread))
            own = np.clip(mean + spread * own, *self.prior.support())
        return X, {**omega, self.parameter: own}

    def start(self) -> dict[str, float]:
        """Return experiments that are all the same."""
        return dict.fromkeys(self.names_of_levels, 0.0) if "spread" in self.parameters else {}

    def grid(self) -> dict[str, FloatArray]:
        """Return one wide spread, from which the experiments are followed."""
        if "spread" not in self.parameters:
            return {}
        # a search's sizes are those of every cause, and reach up to two prior standard deviations
        return {"spread": np.array([[0.0, 2 * 2 * prior_sd(self.prior)]])}

    def estimates(self, theta: Rows, coefficients: Rows) -> dict[str, FloatArray]:
        """Return the spread, and how far each experiment is from their mean.

        Where each has a separate value, these values.
        """
        if self.how == "own":
            return {name: np.asarray(theta[name]) for name in self.names_of_levels}
        first = np.asarray(theta[self.names_of_levels[0]])
        spread = np.broadcast_to(np.asarray(theta.get("spread", self.spread)), first.shape)
        return {"spread": spread, **{name: spread * theta[name] for name in self.names_of_levels}}

    def code(self) -> Code:
        """Return the cause as Python."""
        levels = tuple(zip(self.levels, self.names_of_levels, strict=True))
        table = LevelTable(self.column, levels, "{of}")
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


register(
    Form(
        "parameter-by-experiment",
        ParameterByExperiment,
        lambda context: (
            ParameterByExperiment(parameter, column, labels=context.names.get(column))
            for column in context.labels
            for parameter in context.parameters
            if column != context.experiment or parameter not in context.by_experiment
        ),
        meaning="the parameter {target} differs between the experiments of {column}",
        least_rows=6,
        least_distinct=2,
        lacking=WITHOUT_LABELS,
        headline="{target} differs between experiments, and the simulation has one value",
    )
)
