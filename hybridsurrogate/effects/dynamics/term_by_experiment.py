"""The cause that a term is missing from the dynamics, its rate differing between experiments."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from hybridsurrogate.effects.axis import position_among
from hybridsurrogate.effects.base import Cause, Context, FloatArray, Rows
from hybridsurrogate.effects.code import Code, LevelTable
from hybridsurrogate.effects.dynamics.dynamic import Dynamic
from hybridsurrogate.effects.dynamics.dynamic_term import DynamicTerm
from hybridsurrogate.effects.registry import Form, register
from hybridsurrogate.ode.dynamics import MissingTerm
from hybridsurrogate.types import Prior

# with more experiments a rate that they share predicts nearly as well
_MOST = 6


class TermByExperiment(Dynamic):
    """A term missing from an `OdeSimulator` with another rate in each experiment.

    As `DynamicTerm` of the form ``"proportional"``, ``rate x`` in the slope of the state x. Where
    the known rate constants of two assays differ, that of what is missing may differ as well. An
    experiment that was not measured has a rate of zero.

    Parameters
    ----------
    state : str
    column : str
        The measured column with the experiment of each row.
    prefix : str or None, default=None
        As in `DynamicDrift`.
    prior : frozen scipy.stats distribution or None, default=None
        Of each rate. None: as in `DynamicTerm`.
    levels : tuple of float, default=()
        Values of the column. Empty: those of the measured rows, or 0, 1, ... of labels.
    labels : tuple of str or None, default=None
        What to call them. None: as they are.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> loss = hs.TermByExperiment("b", "assay", prefix="loss", levels=(0.0, 1.0))
    >>> theta = {"rate, assay = 0": np.full(3, -0.2), "rate, assay = 1": np.full(3, -0.1)}
    >>> _, omega = loss.inputs({"assay": np.array([0.0, 1.0, 7.0])}, {}, theta)
    >>> omega["loss_rate"].tolist()
    [-0.2, -0.1, 0.0]
    """

    kind = "missing-term"
    about = "state"
    meaning = (
        "{target} gains or loses something in proportion to it, at another rate in each "
        "experiment, and its equation leaves that out"
    )

    def __init__(
        self,
        state: str,
        column: str,
        prefix: str | None = None,
        prior: Prior | None = None,
        levels: tuple[float, ...] = (),
        labels: tuple[str, ...] | None = None,
    ):
        self.state = state
        self.column = column
        self.prefix = prefix
        self.prior: Prior = prior
        self.levels = levels
        self.labels = labels

    @property
    def reads(self) -> tuple[str, ...]:
        """The column of the experiments."""
        return (self.column,)

    @property
    def variant(self) -> str:
        """The form of the term, and what it differs by."""
        return f"proportional by {self.column}"

    @property
    def name(self) -> str:
        """The kind, the state, and the form of the term."""
        return f"{self.kind}({self.state}, {self.variant})"

    @property
    def modification(self) -> MissingTerm:
        """The change of the right-hand side, of one experiment."""
        return MissingTerm(self.state, "proportional", self.prefix)

    def prepare(self, context: Context) -> Cause:
        """Fill in the experiments and the prior of their rates."""
        term = DynamicTerm(self.state, "proportional", self.prefix).prepare(context)
        found = context.axis(self.column).rows.tolist()
        levels = self.levels or tuple(map(float, range(len(self.labels or ())))) or tuple(found)
        prior = self.prior or term.parameters["rate"]
        return self.filled(prefix=term.prefix, prior=prior, levels=levels)

    @property
    def _names(self) -> list[str]:
        """Names of the experiments' rates."""
        labels = self.labels or tuple(f"{level:.12g}" for level in self.levels)
        return [f"rate, {self.column} = {label}" for label in labels]

    def priors_by_name(self) -> Mapping[str, Prior]:
        """Return the priors of the rates."""
        return dict.fromkeys(self._names, self.prior)

    @property
    def priors_of_change(self) -> Mapping[str, Prior]:
        """The prior of the rate of one experiment."""
        return {"rate": self.prior}

    def inputs(self, X: Rows, omega: Rows, theta: Rows) -> tuple[Rows, Rows]:
        """Run the simulation with the rate of each row's experiment in its right-hand side."""
        which = position_among(self.levels, X[self.column])
        each = np.stack([*(theta[name] for name in self._names), np.zeros(len(which))])
        own = each[which, np.arange(len(which))]
        return X, {**omega, self.modification.full("rate"): own}

    def rows_of(self, X: Rows) -> dict[str, NDArray[np.bool_]]:
        """Return the rows of each experiment."""
        which = position_among(self.levels, X[self.column])
        return {name: which == k for k, name in enumerate(self._names)}

    def start(self) -> dict[str, float]:
        """Return rates of zero."""
        return dict.fromkeys(self._names, 0.0)

    def estimates(self, theta: Rows, coefficients: Rows) -> dict[str, FloatArray]:
        """Return the rates."""
        return {name: np.asarray(theta[name]) for name in self._names}

    def code(self) -> Code:
        """Return the cause as Python."""
        levels = tuple(zip(self.levels, self._names, strict=True))
        return Code(
            "{rate} * {state}",
            columns={"x": self.column},
            does="adds to slope",
            of=self.state,
            states={"state": self.state},
            table=LevelTable(self.column, levels, "1 / {t}"),
            by_row={"rate": "by_level({x}, {table})"},
        )

    def formula(self, values: Mapping[str, float]) -> str:
        """Return the extended simulation in words."""
        rates = ", ".join(f"{values[name]:+.4g} ({name[6:]})" for name in self._names)
        return f"simulation with a rate per experiment times {self.state} in its slope: {rates}"


def _of_states(context: Context) -> Iterator[Cause]:
    column = context.experiment
    # where no rate is known to differ, one that all experiments share comes first
    if column is None or not set(context.by_experiment) & set(context.rates):
        return
    if len(np.unique(context.X[column])) > _MOST:
        return
    for state in context.states:
        yield TermByExperiment(state, column, labels=context.experiment_labels)


register(
    Form(
        "missing-term: proportional by",
        TermByExperiment,
        _of_states,
        headline=(
            "The equation of {target} misses a term in proportion to it that "
            "differs between experiments"
        ),
        call="`TermByExperiment(state, e)`",
        formula="slope of the state + rate of the experiment times the state",
        priors="rates: Student-t, one over the span",
        estimates="rate of each experiment",
        left_out="no declared experiments in which a rate differs, or more than six",
    )
)
