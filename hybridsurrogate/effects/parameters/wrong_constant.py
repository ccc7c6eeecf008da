"""Constants and parameters with other values: a prior that is too narrow, a wrong constant."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from scipy import stats

from hybridsurrogate.effects.base import Cause, Context, Declared, Rows
from hybridsurrogate.effects.expressions import Code
from hybridsurrogate.effects.registry import Form, needs, register
from hybridsurrogate.exceptions import did_you_mean
from hybridsurrogate.priors import frozen
from hybridsurrogate.types import Prior

# the wide prior of a positive parameter goes this factor beyond either end of the given one, that
# of another parameter so many times its width
_WIDE_FACTOR, _N_WIDTHS = 10.0, 5.0
# between these shares a prior lies, whatever its tails
_TAIL_SHARE = 0.001


class _OtherValue(Declared):
    """A constant or a parameter of the simulation with another value."""

    prior: Prior
    note: str

    @property
    def replaces(self) -> str | None:  # type: ignore[override]
        """The constant or the parameter itself."""
        return self.target

    def priors_by_name(self) -> Mapping[str, Prior]:
        """Return the prior of the value."""
        return {"value": self.prior}

    def inputs(self, X: Rows, omega: Rows, theta: Rows) -> tuple[Rows, Rows]:
        """Run the simulation with another value."""
        return X, {**omega, str(self.target): theta["value"]}

    def code(self) -> Code:
        """Return the cause as Python."""
        of, note = str(self.target), self.note
        return Code("{value}", {"value": "{of}"}, does="replaces", of=of, note=note)


@dataclass(eq=False, repr=False)
class NarrowPrior(_OtherValue):
    """A parameter with a value outside its prior; the simulation is right.

    ``simulation(x, parameter = value)``, in the units of the parameter. It is compared where the
    data push a parameter against an end of its prior and the simulation itself can be run: a
    conflict between prior and data (Evans and Moshonov 2006, Bayesian Analysis 1:893) is otherwise
    taken for a fault of the simulation.

    Parameters
    ----------
    parameter : str
        A parameter of the simulation.
    prior : frozen scipy.stats distribution or None, default=None
        Of its value. None: uniform to five widths beyond either end of the given prior. For a
        positive parameter log-uniform, from a tenth of the lower end to ten times the upper end.
    nearest : float or None, default=None
        The value that fits best within the given prior.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> cause = hs.NarrowPrior("rate")
    >>> _, omega = cause.inputs({"t": np.array([1.0])}, {"rate": 0.08}, {"value": 0.05})
    >>> omega["rate"]
    0.05
    """

    kind = "narrow-prior"
    about = "parameter"
    concerns = "prior"
    note = "outside its prior"

    parameter: str
    prior: Prior | None = None
    nearest: float | None = None

    def prepare(self, context: Context) -> Cause:
        """Widen the prior of the simulation."""
        given = context.parameter(self.parameter)
        nearest = context.at_prior_end.get(self.parameter, float(given.ppf(0.5)))
        return self.filled(
            prior=_widened(given) if self.prior is None else self.prior,
            nearest=nearest if self.nearest is None else self.nearest,
        )

    def start(self) -> dict[str, float]:
        """Return the value that fits best within the given prior."""
        assert self.nearest is not None
        return {"value": self.nearest}


def _widened(prior: Prior) -> Prior:
    low, high = (float(end) for end in prior.ppf([_TAIL_SHARE, 1 - _TAIL_SHARE]))
    if low > 0:
        return frozen(stats.loguniform, low / _WIDE_FACTOR, high * _WIDE_FACTOR)
    width = high - low
    return frozen(stats.uniform, loc=low - _N_WIDTHS * width, scale=(1 + 2 * _N_WIDTHS) * width)


register(
    Form(
        "narrow-prior",
        NarrowPrior,
        lambda context: map(NarrowPrior, context.at_prior_end),
        meaning=(
            "the simulation may be right: the prior of {target} excludes the value that the "
            "data ask for"
        ),
        lacking=needs(
            lambda context: context.at_prior_end,
            "the data push no parameter against an end of its prior, or it cannot be run beyond",
        ),
        headline="The prior of {target} excludes the value that the data ask for",
    )
)


@dataclass(eq=False, repr=False)
class WrongConstant(_OtherValue):
    """An assumed constant of the simulation that has another value.

    ``simulation(x, constant = value)``, in the units of the constant; the prior is the one that the
    simulation gives with `Assumed`.

    Parameters
    ----------
    constant : str
        Name of the assumed constant.
    prior : frozen scipy.stats distribution or None, default=None
        Of its value. None: that of the simulation.
    assumed : float or None, default=None
        The value that was assumed. None: that of the simulation.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> cause = hs.WrongConstant("gravity")
    >>> _, omega = cause.inputs({"t": np.array([1.0])}, {"gravity": 9.8}, {"value": 9.7})
    >>> omega["gravity"]
    9.7
    """

    kind = "wrong-constant"
    about = "constant"

    constant: str
    prior: Prior | None = None
    assumed: float | None = None

    def prepare(self, context: Context) -> Cause:
        """Take the prior and the assumed value from the simulation."""
        if self.constant not in context.assumed:
            raise ValueError(
                f"{self.constant!r} is not an assumed constant of the simulation; these are: "
                f"{list(context.assumed)}.{did_you_mean(self.constant, context.assumed)}"
            )
        constant = context.assumed[self.constant]
        prior = constant.prior if self.prior is None else self.prior
        return self.filled(prior=prior, assumed=constant.value)

    @property
    def note(self) -> str:  # type: ignore[override]
        """Its assumed value."""
        assert self.assumed is not None
        return f"was {self.assumed:.4g}"

    def start(self) -> dict[str, float]:
        """Return the assumed value."""
        assert self.assumed is not None
        return {"value": self.assumed}


register(
    Form(
        "wrong-constant",
        WrongConstant,
        lambda context: map(WrongConstant, context.assumed),
        meaning="the assumed constant {target} has another value",
        lacking=needs(lambda context: context.assumed, "the simulation has no assumed constants"),
        headline="The assumed constant {target} is wrong: the data ask for {value}",
    )
)
