"""The interface of a cause: how the simulation meets the measurements.

For measured rows the simulation's output eta becomes
``gain * eta(inputs) + columns @ a`` with noise scale ``noise * sigma``; a cause rewrites any of the
four, and each is the identity by default. What is no factor but follows the output itself, such as
a limit, overrides ``response`` instead of ``gain``.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from functools import partial
from numbers import Integral
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Self, get_args

import numpy as np
from numpy.typing import NDArray

from hybridsurrogate.arguments import (
    as_real,
    check_flag,
    check_mapping,
    check_name,
    check_number,
    described,
)
from hybridsurrogate.effects.context import Axis, Context, OutputScale, Rows
from hybridsurrogate.effects.expressions import (
    Code,
    Printer,
    in_latex,
    in_words,
    sentence,
)
from hybridsurrogate.priors import check_prior, check_priors
from hybridsurrogate.simulation.modification import Modification
from hybridsurrogate.types import FloatArray, Prior

# prior sd of coefficients whose columns have their size
UNIT_SD = 1.0
# usual change of the logarithm of a parameter that keeps its sign: halving and doubling
USUAL_CHANGE = 0.7

if TYPE_CHECKING:
    # scikit-learn has no types: of a class that may be anything, no arguments are checked

    class BaseEstimator:
        """What causes have of that class."""

        def get_params(self, deep: bool = True) -> dict[str, Any]:
            """Return the arguments of the constructor."""

else:
    from sklearn.base import BaseEstimator


def _check_cause(value: Any, name: str) -> None:
    if not isinstance(value, Cause):
        raise TypeError(f"{name} must be a cause such as Offset(), got {described(value)}.")
    check_arguments(value)


def _check_instance(value: Any, name: str, of: type) -> None:
    if not isinstance(value, of):
        raise TypeError(
            f"{name} must be an {of.__name__} of measured rows, got {described(value)}."
        )


# by annotation; other annotations are checked by the cause
_CHECKS: dict[str, Callable[[Any, str], Any]] = {
    "str": partial(check_name, example='"t"'),
    "Prior": check_prior,
    "float": as_real,
    "int": partial(check_number, kind=Integral),
    "bool": check_flag,
    "Cause": _check_cause,
    "Axis": partial(_check_instance, of=Axis),
    "OutputScale": partial(_check_instance, of=OutputScale),
    "Mapping[str, Prior]": check_priors,
    "Mapping[str, tuple[float, float]]": partial(
        check_mapping, entry="range", example='{"t": (0, 10)}'
    ),
}


def check_arguments(cause: Cause) -> None:
    """Raise TypeError or ValueError for an argument that its annotation does not allow.

    Examples
    --------
    >>> import hybridsurrogate as hs
    >>> check_arguments(hs.Trend(["t"]))
    Traceback (most recent call last):
    ...
    TypeError: column of Trend must be a name, such as "t", got ['t'] (list).
    """
    kind = type(cause)
    for one in inspect.signature(kind).parameters.values():
        check = _CHECKS.get(str(one.annotation).removesuffix(" | None"))
        value = getattr(cause, one.name, None)
        # None may be what is None by default
        if check is not None and (value is not None or one.default is not None):
            check(value, f"{one.name} of {kind.__name__}")


# the form of a cause for an argument and its value
Forms = Mapping[tuple[str, Any], str]

Act = Literal["inputs", "gain", "response", "noise", "outliers", "overdispersion"]

# the name under which `Cause.noise` finds the simulation's output, where it asks for it
SIMULATED = "simulated output"
# those under which it finds the slope of that over `follows_slope`, and `estimates` the noise's sd
SLOPE = "slope of the simulated output"
# that under which `Cause.columns` finds at which position, from 0, a row stands in its table
ROW = "position of the row"
# that of known errors of the rows, on the scale of eta, in a last column of rows X
ERROR = "error of the row"
NOISE_SD = "sd of the noise"
# those under which rows of several outputs whose errors are correlated carry, after `ERROR`, the
# number of their measurement, what was measured (on the scale of eta) and, where they are known,
# the correlations of its error with those of each output
MEASUREMENT, MEASURED, CORRELATION = "number of the measurement", "measured value", "correlation"


def of_wave(theta: Rows) -> dict[str, FloatArray]:
    """Return numbers by name, those of a sine and a cosine as their amplitude."""
    if "cosine" not in theta:
        return dict(theta)
    amplitude = np.hypot(theta["sine"], theta["cosine"])
    return {"period": np.asarray(theta["period"]), "amplitude": amplitude}


def quantiles(prior: Prior, n: int) -> FloatArray:
    """Return quantiles of a prior at the middles of n equal shares."""
    return np.asarray(prior.ppf((np.arange(n) + 0.5) / n))


class Cause(BaseEstimator):
    """A named mechanism between simulation and measurements; subclass it to define one.

    Attributes
    ----------
    kind : str
        The word by which reports call the cause.
    target : str or None
        The input, parameter, constant or column concerned.
    parameters : dict of name to frozen scipy.stats prior
        The cause's nonlinear parameters, ``theta``.
    coefficients : tuple of str
        Names of the columns' coefficients, which are linear and integrated out exactly.
    coefficient_sd : float or None
        Their prior standard deviation on the scale of eta; None: three times its spread.
    output : str or None
        Of several outputs the one that it concerns; None: all of them, or the only one.
    by_output : bool
        Whether it has numbers of its own for each of several outputs.
    meaning : str or None
        What the cause means for the one who wrote the simulation, for a report; None: as its kind.
    is_process : bool
        Whether the columns are the basis of one random curve, so that they share one size.
    is_smooth_curve : bool
        Whether it adds a smooth curve of any shape, which knows nothing beyond the measured range.
    is_one_level : bool
        Whether it is one of several that differ only in the level of a column that is meant.
    is_screened : bool
        Whether it looks only where the measured output is unusual: a test's replicates are so
        elsewhere, and leave it out.
    log_prior_of_choice : float
        Of a cause that is made from the measured output: the logarithm of the probability, before
        the data, of what was chosen.
    is_learned : bool
        Whether measured rows inform it; else its numbers are drawn from their priors.
    hierarchy : (str, str, tuple of str) or None
        Where its parameters are deviations from a mean, as in ``mean + spread deviation``: the
        parameter of the simulation, the name of the spread, those of the deviations.
    follows_mean : bool
        Whether ``noise`` looks at the simulation's output: ``X[SIMULATED]``, on the scale of eta.
    follows_slope : (str, float) or None
        Over which input or parameter ``noise`` looks at the slope of that output, ``X[SLOPE]``, per
        unit; and a usual change of it, in its unit. Only with one output.
    replaces : str or None
        The assumed constant or the parameter whose value the cause infers, if it does.
    unit_of_output : float
        What one of its coefficients is in the user's units, before any logarithm.

    Notes
    -----
    ``X``, ``omega`` and ``theta`` are mappings from names to arrays of shape (n,), in the user's
    units: all rows of all draws come in one call, one draw after the other, so methods must be
    vectorised.

    Names, priors and coefficients are plain class attributes, because that is all that a
    user-defined cause needs. Where target and priors are arguments, `Declared` says which; other
    causes override them by properties, which type checkers reject without
    ``# type: ignore[override]``.

    Examples
    --------
    Air drag missing from a simulated fall, ten lines:

    >>> from scipy.stats import halfnorm
    >>> import hybridsurrogate as hs
    >>> class AirDrag(hs.Cause):
    ...     kind = "air-drag"
    ...     target = "t"
    ...     parameters = {"rate": halfnorm(scale=0.5)}
    ...     coefficients = ("amplitude",)
    ...
    ...     def columns(self, X, theta):
    ...         return (1 - np.exp(-theta["rate"] * X["t"] ** 3))[:, None]
    """

    kind: str = "cause"
    target: str | None = None
    parameters: Mapping[str, Prior] = {}
    coefficients: tuple[str, ...] = ()
    coefficient_sd: float | None = None
    output: str | None = None
    by_output: bool = False
    meaning: str | None = None
    is_process: bool = False
    is_smooth_curve: bool = False
    is_one_level: bool = False
    is_screened: bool = False
    log_prior_of_choice: float = 0.0
    is_learned: bool = True
    hierarchy: tuple[str, str, tuple[str, ...]] | None = None
    follows_mean: bool = False
    follows_slope: tuple[str, float] | None = None
    replaces: str | None = None
    unit_of_output: float = 1.0
    _overridden: ClassVar[frozenset[Act]] = frozenset()

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        acts = (act for act in get_args(Act) if getattr(cls, act) is not getattr(Cause, act))
        cls._overridden = frozenset(acts)

    def prepare(self, context: Context) -> Cause:
        """Return the cause with every default filled in from the context.

        Parameters
        ----------
        context : Context
        """
        return self

    def filled(self, **changes: Any) -> Self:
        """Return a cause of the same class, a user-defined subclass too, with other arguments."""
        return type(self)(**{**self.get_params(deep=False), **changes})

    def inputs(self, X: Rows, omega: Rows, theta: Rows) -> tuple[Rows, Rows]:
        """Return the inputs and parameters with which the simulation is run for these rows.

        Parameters
        ----------
        X, omega, theta : dict of name to ndarray of shape (n,)
            Measured columns; the simulation's parameters and constants; the cause's parameters.

        Returns
        -------
        X, omega : dict of name to ndarray of shape (n,)
            With the same names.
        """
        return X, omega

    def rows_of(self, X: Rows) -> dict[str, NDArray[np.bool_]]:
        """Return the rows that the cause's parameters change, of those that change not all.

        Parameters that have no row in common share a run where slopes are taken.

        Parameters
        ----------
        X : dict of name to ndarray of shape (n,)

        Returns
        -------
        dict of name to ndarray of bool of shape (n,)
        """
        return {}

    def gain(self, X: Rows, theta: Rows) -> FloatArray | float:
        """Return the factor on the simulation.

        Parameters
        ----------
        X, theta : dict of name to ndarray of shape (n,)

        Returns
        -------
        ndarray of shape (n,), or float
        """
        return 1.0

    def response(
        self, simulated: FloatArray, X: Rows, theta: Rows
    ) -> tuple[FloatArray, FloatArray] | None:
        """Return what becomes of the simulated output, and the slope of the one over the other.

        By default the output times its gain. The slope propagates an emulator's error: around
        the coefficients estimated from the runs, these stay conditionally Gaussian.

        Parameters
        ----------
        simulated : ndarray of shape (n,)
            On the scale of eta.
        X, theta : dict of name to ndarray of shape (n,)

        Returns
        -------
        values, slopes : ndarray of shape (n,)
            None: the output stays what it is.
        """
        gain = np.asarray(self.gain(X, theta))
        if not gain.ndim and gain == 1.0:
            return None
        return gain * simulated, np.broadcast_to(gain, simulated.shape)

    def columns(self, X: Rows, theta: Rows) -> FloatArray | None:
        """Return the added columns, one for each name in ``coefficients``.

        Parameters
        ----------
        X, theta : dict of name to ndarray of shape (n,)

        Returns
        -------
        ndarray of shape (n, q), or None
            A coefficient times its column is on the scale of eta.
        """
        factors = self.factors(X, theta)
        return None if factors is None else factors[0] * factors[1]

    def factors(self, X: Rows, theta: Rows) -> tuple[FloatArray, FloatArray] | None:
        """Return the columns' parts of rows and of theta.

        A cause whose columns are products of such parts gives them instead of ``columns``, for
        speed.

        Parameters
        ----------
        X : dict of name to ndarray of shape (n,)
        theta : dict of name to ndarray of shape (J,)

        Returns
        -------
        pair of ndarray, shapes (n, q) and (J, q), or None
        """
        return None

    def noise(self, X: Rows, theta: Rows) -> FloatArray | float:
        """Return the factor on the noise scale.

        It may depend on parameters that a search enumerates (`grid`), not on sizes (`start`).

        Parameters
        ----------
        X, theta : dict of name to ndarray of shape (n,)
            With ``follows_mean`` also ``X[SIMULATED]``, with ``follows_slope`` ``X[SLOPE]``.

        Returns
        -------
        ndarray of shape (n,), or float
        """
        return 1.0

    def outliers(self, theta: Rows) -> FloatArray | float:
        """Return the share of measurements that are outliers.

        Parameters
        ----------
        theta : dict of name to ndarray of shape (J,)

        Returns
        -------
        ndarray of shape (J,), or float
        """
        return 0.0

    def leaves_out(self, X: Rows, y: FloatArray) -> NDArray[np.bool_] | None:
        """Return which measured rows an estimator with this cause does not learn from.

        Parameters
        ----------
        X : dict of name to ndarray of shape (n,)
        y : ndarray of shape (n,)
            As measured.

        Returns
        -------
        ndarray of bool of shape (n,), or None
            None: it learns from all.
        """
        return None

    def overdispersion(self, theta: Rows) -> FloatArray | float:
        """Return the relative scatter of means, beyond what a likelihood without a scale allows.

        Parameters
        ----------
        theta : dict of name to ndarray of shape (J,)

        Returns
        -------
        ndarray of shape (J,), or float
        """
        return 0.0

    def grid(self) -> dict[str, FloatArray]:
        """Return nodes of those parameters that a search has to enumerate.

        By default quantiles of the prior, for every parameter that is not in ``start``; a search
        refines them where the data ask for it.

        Returns
        -------
        dict of name to ndarray of shape (n_nodes,) or (n_nodes, 2)
            Nodes, or ends of cells within which nothing changes. A search takes all combinations
            and refines cells around nodes.
        """
        names = [name for name in self.parameters if name not in self.start()]
        n = {1: 15, 2: 8}.get(len(names), 4)
        return {name: quantiles(self.parameters[name], n) for name in names}

    def start(self) -> dict[str, float]:
        """Return parameters that are sizes, and the values at which they change nothing.

        A size, such as a slope or a factor, is followed from there by linearisation.

        Returns
        -------
        dict of name to float
        """
        return {}

    def estimates(self, theta: Rows, coefficients: Rows) -> dict[str, FloatArray]:
        """Return draws of what a report states, in the user's units.

        By default all of theta, and the coefficients unless they are the basis of a process.

        Parameters
        ----------
        theta, coefficients : dict of name to ndarray of shape (n_draws,)
            With ``follows_slope`` also ``theta[NOISE_SD]``, on the scale of eta.

        Returns
        -------
        dict of name to ndarray of shape (n_draws,)
        """
        return dict(theta) if self.is_process else {**theta, **coefficients}

    def formula(self, values: Mapping[str, float]) -> str:
        """Return the extended simulation in plain text, with numbers.

        By default the expression of ``shown``; a cause that has none is named with its numbers.

        Parameters
        ----------
        values : dict of name to float
            What ``estimates`` names, one number each.
        """
        text = self._printed(in_words, values)
        if text is not None:
            return text
        terms = ", ".join(f"{name} = {value:.4g}" for name, value in values.items())
        return f"simulation with {self.kind} ({terms})"

    def latex(self, values: Mapping[str, float]) -> str:
        """Return the extended simulation in LaTeX; the words of a ``formula`` that is overridden.

        Parameters
        ----------
        values : dict of name to float
        """
        own = type(self).formula is not Cause.formula
        text = None if own else self._printed(in_latex, values)
        return sentence(self.formula(values)) if text is None else text

    def _printed(self, printer: Printer, values: Mapping[str, float]) -> str | None:
        shown = self.shown()
        # of noise or of a delay there is no expression of the simulation
        if shown is None or shown.does in ("scatters", "delays", "nothing"):
            return None
        try:
            return printer(shown, values, self.extents)
        except (SyntaxError, KeyError):  # a user's, which only `to_python` has to read
            return None

    def shown(self) -> Code | None:
        """Return the expression that a formula prints; by default that of ``code``."""
        return self.code()

    def code(self) -> Code | None:
        """Return the cause as Python, for `DiscrepancyDiagnosis.to_python`.

        None: a module that is written takes the cause itself as an argument.
        """
        return None

    @property
    def inner(self) -> Cause:
        """The cause itself: of one in one of several outputs the one that is in it."""
        return self

    @property
    def reads(self) -> tuple[str, ...]:
        """Names of the columns that the cause looks at: an extended simulation needs them.

        By default the target.
        """
        return (self.target,) if self.target else ()

    @property
    def extents(self) -> Mapping[str, float]:
        """How far measured rows reach along columns: a formula's places resolve that."""
        return {}

    @property
    def modification(self) -> Modification | None:
        """The change of an ODE's right-hand side whose numbers `inputs` sets, if there is one."""
        return None

    @property
    def acts_on(self) -> frozenset[Act]:
        """What the cause rewrites in addition to what it adds: the names of those methods.

        "inputs": rows are simulated at other inputs or parameters; "gain": the simulated output has
        a factor; "response": it becomes something else than itself times a factor; "noise":
        its scale differs between rows; "outliers": it has heavy tails; "overdispersion": values
        scatter more than a likelihood without a scale of the noise allows.
        """
        return self._overridden

    @property
    def touches_simulation(self) -> bool:
        """Whether the cause changes the simulation's output itself and does not only add to it."""
        return not self.acts_on.isdisjoint(("inputs", "gain", "response"))

    @property
    def factorises(self) -> bool:
        """Whether the columns are given by `factors`."""
        return type(self).columns is Cause.columns and type(self).factors is not Cause.factors

    @property
    def is_correlated_noise(self) -> bool:
        """Whether this is noise that neighbouring rows share: a process that is not in the mean."""
        return self.is_process and not self.changes_output

    @property
    def concerns(self) -> str:
        """What is at fault: "simulation", "noise", "inputs", "data" or "prior".

        By default the simulation where its mean changes, else the noise of the measurements.
        """
        return "simulation" if self.changes_output else "noise"

    @property
    def changes_output(self) -> bool:
        """Whether the extended simulation differs from the plain one: noise does not count."""
        return bool(self.coefficients) or self.touches_simulation

    @property
    def variant(self) -> str:
        """Which of several forms of the kind it is, in a word or two; "" for the plain one."""
        return ""

    @property
    def name(self) -> str:
        """The kind and, where there is one, the target."""
        return f"{self.kind}({self.target})" if self.target else self.kind


class Declared(Cause):
    """A cause whose target and priors are among its arguments.

    Attributes
    ----------
    about : str
        The argument that is the target; "": there is none.
    unknowns : tuple of str
        The arguments that are priors of its parameters.
    forms : dict of (str, value) to str
        Its variant where an argument has such a value.
    """

    about: str = ""
    unknowns: tuple[str, ...] = ()
    forms: ClassVar[Forms] = {}

    @property
    def target(self) -> str | None:  # type: ignore[override]
        """The input, parameter, constant or column concerned."""
        return getattr(self, self.about) if self.about else None

    @property
    def variant(self) -> str:
        """The form that its arguments choose."""
        chosen = (
            form for (name, value), form in self.forms.items() if getattr(self, name) == value
        )
        return next(chosen, "")

    @property
    def parameters(self) -> Mapping[str, Prior]:  # type: ignore[override]
        """The priors of what is unknown."""
        return self.priors_by_name()

    def priors_by_name(self) -> Mapping[str, Prior]:
        """Return the priors of what is unknown, by default those arguments."""
        return {name: getattr(self, name) for name in self.unknowns}


class Wrapped(Cause):
    """A cause around another one: what it does not override is that of the other.

    Parameters
    ----------
    cause : Cause
    """

    def __init__(self, cause: Cause):
        self.cause = cause


def _forwarded(name: str) -> property:
    return property(lambda self: getattr(self.cause, name), doc="That of the cause.")


for _name in vars(Cause).keys() - {"filled", "prepare", "output", "inner", "unit_of_output"}:
    if not _name.startswith("_"):
        setattr(Wrapped, _name, _forwarded(_name))


class Nothing(Cause):
    """No further cause: what later ones are compared with once one is accepted.

    Examples
    --------
    >>> Nothing().coefficients, Nothing().parameters
    ((), {})
    """

    kind = "none"
