"""An assumed constant that has another value."""

from __future__ import annotations

from collections.abc import Mapping

from hybridsurrogate.effects.base import Cause, Context, Declared, Rows
from hybridsurrogate.effects.code import Code
from hybridsurrogate.effects.registry import Form, register
from hybridsurrogate.exceptions import did_you_mean
from hybridsurrogate.types import Prior


class WrongConstant(Declared):
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

    def __init__(self, constant: str, prior: Prior | None = None, assumed: float | None = None):
        self.constant = constant
        self.prior = prior
        self.assumed = assumed

    @property
    def replaces(self) -> str | None:
        """The constant itself."""
        return self.constant

    def priors_by_name(self) -> Mapping[str, Prior]:
        """Return the prior of the constant's value."""
        return {"value": self.prior}

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

    def inputs(self, X: Rows, omega: Rows, theta: Rows) -> tuple[Rows, Rows]:
        """Run the simulation with another value of the constant."""
        return X, {**omega, self.constant: theta["value"]}

    def start(self) -> dict[str, float]:
        """Return the assumed value."""
        assert self.assumed is not None
        return {"value": self.assumed}

    def code(self) -> Code:
        """Return the cause as Python."""
        assert self.assumed is not None
        was = f"was {self.assumed:.4g}"
        return Code("{value}", {"value": "{of}"}, does="replaces", of=self.constant, note=was)


def _lacking(context: Context) -> list[tuple[None, str]]:
    return [] if context.assumed else [(None, "the simulation has no assumed constants")]


register(
    Form(
        "wrong-constant",
        WrongConstant,
        lambda context: map(WrongConstant, context.assumed),
        meaning="the assumed constant {target} has another value",
        lacking=_lacking,
        like=("gain", "parameter-drift"),
        headline="The assumed constant {target} is wrong: the data ask for {value}",
        formula="eta(c = value)",
        priors="value: the prior given with `Assumed`",
        estimates="value",
        left_out="the simulation assumes no constants",
    )
)
