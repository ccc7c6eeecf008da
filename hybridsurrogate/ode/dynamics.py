"""What may be wrong with the right-hand side of an ODE: rate, term, delay, store."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from hybridsurrogate.arguments import check_choice
from hybridsurrogate.exceptions import did_you_mean
from hybridsurrogate.numerics import hilbert
from hybridsurrogate.simulation.modification import Modification, Numbers
from hybridsurrogate.types import FloatArray


def _check_known(missing: str, name: str, known: Sequence[str]) -> None:
    """Raise ValueError, that begins with what is missing, for another name than the known ones."""
    if name not in known:
        raise ValueError(f"{missing} {name!r}; there are {list(known)}.{did_you_mean(name, known)}")


@dataclass(frozen=True)
class _OfParameter(Modification):
    """A course in time of a parameter of the right-hand side."""

    parameter: str

    is_in_time = True

    def check(self, rates: Sequence[str], states: Sequence[str]) -> None:
        """Raise ValueError where the right-hand side does not take the parameter."""
        _check_known("rhs has no parameter", self.parameter, rates)


@dataclass(frozen=True)
class _OfState(Modification):
    """A change in the slope of a state."""

    state: str

    def check(self, rates: Sequence[str], states: Sequence[str]) -> None:
        """Raise ValueError where there is no such state."""
        _check_known("There is no state", self.state, states)


@dataclass(frozen=True)
class CoupledStore(_OfState):
    """A state z that the equations lack and that exchanges with one of their states, x.

    ``dx/dt = ... - k (x - z)`` and ``dz/dt = k / ratio (x - z)``: the wall of a heated box, the
    tissue of pharmacokinetics (Gibaldi and Perrier 1982, Pharmacokinetics, chapter 2). Alone the
    two come together as ``exp(-t / scale)``, so that ``k = ratio / (scale (1 + ratio))``. At the
    start z is x plus a gap. A store of ratio zero takes nothing.

    With ``through`` the term of a parameter, g(x), acts on the store instead: ``dx/dt = ... - g(x)
    - k (x - z)`` and ``dz/dt = (k (x - z) + g(z)) / ratio``, as heat is lost through the wall of
    the box (Bacher and Madsen 2011, Energy and Buildings 43, model TiTe). Its parts in the slopes
    of other states follow z as well.

    Parameters
    ----------
    state : str
    prefix : str or None, default=None
        What the full names of the numbers begin with; None: the state, the parameter and "store".
    through : str or None, default=None
        The parameter that multiplies the term, or divides it; None: no term is moved.
    divides : bool, default=False
        Whether it divides: the term is gone where the parameter is infinite, else where it is zero.

    Examples
    --------
    >>> from hybridsurrogate.ode.dynamics import CoupledStore
    >>> CoupledStore("air").constants
    {'air_store_ratio': 0.0, 'air_store_scale': 1.0, 'air_store_gap': 0.0}
    """

    prefix: str | None = None
    through: str | None = None
    divides: bool = False

    sizes = ("ratio",)
    is_in_time = True

    @property
    def label(self) -> str:
        """The prefix, or the state, the parameter and "store"."""
        return self.prefix or "_".join(filter(None, (self.state, self.through, "store")))

    @property
    def neutral(self) -> dict[str, float]:
        """A ratio of zero; scale and gap."""
        return {"ratio": 0.0, "scale": 1.0, "gap": 0.0}

    @property
    def couples_to(self) -> str:
        """The state with which it exchanges."""
        return self.state

    @property
    def takes_over(self) -> tuple[str, float] | None:
        """The parameter whose term acts on the store, and its value without that term."""
        return None if self.through is None else (self.through, np.inf if self.divides else 0.0)

    def check(self, rates: Sequence[str], states: Sequence[str]) -> None:
        """Raise ValueError where there is no such state, or no such parameter."""
        super().check(rates, states)
        if self.through is not None:
            _check_known("rhs has no parameter", self.through, rates)

    def begins(self, state: FloatArray, numbers: Numbers) -> FloatArray:
        """Return the unseen state at the start, (m,)."""
        return state + numbers["gap"]

    def exchange(
        self, state: FloatArray, unseen: FloatArray, numbers: Numbers, term: FloatArray | float
    ) -> tuple[FloatArray, FloatArray]:
        """Return what is added to the slope of the state, and the slope of the unseen one, (m,)."""
        ratio = numbers["ratio"]
        flow = (state - unseen) / (numbers["scale"] * (1 + ratio))
        # a store without size takes no term over
        own = flow + term / np.where(ratio == 0, 1.0, ratio) if self.through else flow
        return -ratio * flow, own


# the parameter changes by a factor of at most exp(5): beyond it no solver gets through
_MAX_LOG_CHANGE = 5.0


@dataclass(frozen=True)
class WanderingParameter(_OfParameter):
    """A parameter p that becomes p exp(c(t)) in the right-hand side, c a sum of waves.

    Parameters
    ----------
    parameter : str
    low, high : float
        Times between which the curve c lives, see `numerics.hilbert`.
    n : int
        Waves of which it is a sum.
    prefix : str or None, default=None
        What the full names of the numbers begin with; None: the parameter and "process".
    """

    low: float
    high: float
    n: int
    prefix: str | None = None

    @property
    def label(self) -> str:
        """The prefix, or the parameter and "process"."""
        return self.prefix or f"{self.parameter}_process"

    @property
    def neutral(self) -> dict[str, float]:
        """The waves at zero."""
        return dict.fromkeys(self.sizes, 0.0)

    @property
    def sizes(self) -> tuple[str, ...]:
        """The coefficients of the waves."""
        return wave_names(self.n)

    def factors(self, t: FloatArray, numbers: Numbers, step: float) -> dict[str, FloatArray]:
        """Return the factor on the parameter, (k, m)."""
        scaled = (2 * t[:, 0] - self.low - self.high) / (self.high - self.low)
        change = hilbert.cosines(scaled, self.n) @ coefficients(numbers, self.n).T
        return {self.parameter: np.exp(np.clip(change, -_MAX_LOG_CHANGE, _MAX_LOG_CHANGE))}


def wave_names(n: int) -> tuple[str, ...]:
    """Return the names of the coefficients of n waves."""
    return tuple(f"wave_{k}" for k in range(1, n + 1))


def coefficients(numbers: Numbers, n: int) -> FloatArray:
    """Return the coefficients of n waves (m, n) of m draws."""
    return np.stack([np.asarray(numbers[name]) for name in wave_names(n)], axis=-1)


FORMS = ("constant", "proportional", "seasonal", "power", "saturating", "threshold", "product")


@dataclass(frozen=True)
class TimeVaryingParameter(_OfParameter):
    """A parameter or assumed constant p that becomes p (1 + amount s(t)) in the right-hand side.

    The initial state and what is observed keep p itself.

    Parameters
    ----------
    parameter : str
    shape : {"step", "ramp", "logistic", "exponential", "periodic"}
        What s(t) is:

        - step: 0 before `location`, 1 after; a tanh over about two steps of the solver, so that a
          Runge-Kutta method keeps its accuracy;
        - ramp: (t - location) / duration, cut to [0, 1];
        - logistic: 1 / (1 + exp(-(t - location) / width));
        - exponential: the factor on p is exp(rate (t - center));
        - periodic: instead of amount s(t), sine sin(a) + cosine cos(a) with
          a = 2 pi (t - center) / period.
    prefix : str or None, default=None
        What the full names of the numbers begin with; None: parameter and shape.
    center : float, default=0.0
        Of the exponential and the periodic shape.

    Notes
    -----
    An amount below -1 turns the sign of p around; nothing is cut off, so a prior of the amount
    must have the support that p allows.

    Examples
    --------
    >>> from hybridsurrogate.ode.dynamics import TimeVaryingParameter
    >>> TimeVaryingParameter("rate", "step").constants
    {'rate_step_amount': 0.0, 'rate_step_location': 0.0}
    """

    shape: str
    prefix: str | None = None
    center: float = 0.0

    def __post_init__(self) -> None:
        check_choice(self.shape, "shape", list(_SHAPES))

    @property
    def label(self) -> str:
        """The prefix, or parameter and shape."""
        return self.prefix or f"{self.parameter}_{self.shape}"

    @property
    def neutral(self) -> dict[str, float]:
        """The sizes at zero, then location, width, duration or period."""
        return dict.fromkeys(self.sizes, 0.0) | _SHAPES[self.shape].others

    @property
    def sizes(self) -> tuple[str, ...]:
        """The amount, the rate, or sine and cosine."""
        return _SHAPES[self.shape].sizes

    def factors(self, t: FloatArray, numbers: Numbers, step: float) -> dict[str, FloatArray]:
        """Return the factor on the parameter."""
        return {self.parameter: 1 + _course(self.shape, t, self.center, numbers, step)}


@dataclass(frozen=True)
class MissingTerm(_OfState):
    """A term that the right-hand side lacks in the slope of one state.

    Parameters
    ----------
    state : str
    form : {"constant", "proportional", "seasonal", "power", "saturating", "threshold", "product"}
        What the term is, x being the state:

        - constant: rate;
        - proportional: rate x;
        - seasonal: a forcing from outside, sine sin(a) + cosine cos(a) with
          a = 2 pi (t - center) / period;
        - power: rate size (|x| / size)^exponent, with the sign of x: crowding with exponent 2, the
          outflow of a tank with 1/2;
        - saturating: rate x / (half + |x|), the law of Michaelis and Menten (1913);
        - threshold: rate (x - level) where x is above the level, else nothing: an overflow;
        - product: rate x times another state, as where two species meet.
    prefix : str or None, default=None
        What the full names of the numbers begin with; None: state and form.
    center : float, default=0.0
        Of the seasonal form.
    size : float, default=1.0
        Of the power: a typical size of the state.
    other : str or None, default=None
        The other state of a product.

    Examples
    --------
    >>> from hybridsurrogate.ode.dynamics import MissingTerm
    >>> MissingTerm("i", "proportional").constants
    {'i_proportional_rate': 0.0}
    """

    form: str
    prefix: str | None = None
    center: float = 0.0
    size: float = 1.0
    other: str | None = None

    def __post_init__(self) -> None:
        check_choice(self.form, "form", FORMS)
        if (self.form == "product") != (self.other is not None):
            raise ValueError(
                "A product needs the name of the other state, other forms have none: got "
                f"form={self.form!r}, other={self.other!r}."
            )

    @property
    def label(self) -> str:
        """The prefix, or state and form."""
        return self.prefix or "_".join(filter(None, (self.state, self.form, self.other)))

    @property
    def neutral(self) -> dict[str, float]:
        """A rate of zero, or sine and cosine; then period, exponent, half or level."""
        return dict.fromkeys(self.sizes, 0.0) | _FURTHER_NUMBERS.get(self.form, {})

    @property
    def sizes(self) -> tuple[str, ...]:
        """The rate, or sine and cosine."""
        return ("sine", "cosine") if self.is_in_time else ("rate",)

    @property
    def is_in_time(self) -> bool:
        """Whether it has a period."""
        return self.form == "seasonal"

    def check(self, rates: Sequence[str], states: Sequence[str]) -> None:
        """Raise ValueError where there is no such state."""
        super().check(rates, states)
        if self.other is not None:
            _check_known("There is no state", self.other, states)

    def drives(self, t: FloatArray, numbers: Numbers, step: float) -> dict[str, FloatArray]:
        """Return the term, where it does not follow the state."""
        if self.is_in_time:
            return {self.state: _course("periodic", t, self.center, numbers, step)}
        if self.form == "constant":
            return {self.state: np.broadcast_to(numbers["rate"], (len(t), len(numbers["rate"])))}
        return {}

    def terms(self, state: Mapping[str, FloatArray], numbers: Numbers) -> dict[str, FloatArray]:
        """Return the term, where it follows the state."""
        shape = _OF_STATE.get(self.form)
        if shape is None:
            return {}
        x = state[self.state]
        term = shape(x, state[self.other or self.state], numbers, self.size)
        return {self.state: numbers["rate"] * term}


# in addition to the sizes
_FURTHER_NUMBERS = {
    "seasonal": {"period": 1.0},
    "power": {"exponent": 1.0},
    "saturating": {"half": 1.0},
    "threshold": {"level": 0.0},
}
# of the state, another one, the numbers, and the size
_OF_STATE: dict[str, Callable[[FloatArray, FloatArray, Numbers, float], FloatArray]] = {
    "proportional": lambda x, *_: x,
    "power": lambda x, _, numbers, size: np.copysign(
        size * np.abs(x / size) ** numbers["exponent"], x
    ),
    "saturating": lambda x, _, numbers, size: x / (numbers["half"] + np.abs(x)),
    "threshold": lambda x, _, numbers, size: np.maximum(x - numbers["level"], 0.0),
    "product": lambda x, other, *_: x * other,
}


@dataclass(frozen=True)
class DelayedState(_OfState):
    """A right-hand side that follows one state as it was a lag ago, in all slopes.

    Before the start the state is what it is there. The method of the simulator must be "rk4".

    Parameters
    ----------
    state : str
    prefix : str or None, default=None
        What the full name of the lag begins with; None: the state and "delayed".

    Examples
    --------
    >>> from hybridsurrogate.ode.dynamics import DelayedState
    >>> DelayedState("i").constants
    {'i_delayed_lag': 0.0}
    """

    prefix: str | None = None

    sizes = ("lag",)
    looks_back = True

    @property
    def label(self) -> str:
        """The prefix, or the state and "delayed"."""
        return self.prefix or f"{self.state}_delayed"

    @property
    def neutral(self) -> dict[str, float]:
        """A lag of zero."""
        return {"lag": 0.0}

    def lags(self, numbers: Numbers) -> dict[str, FloatArray]:
        """Return the lag."""
        return {self.state: numbers["lag"]}


def _course(name: str, t: FloatArray, center: float, numbers: Numbers, step: float) -> FloatArray:
    """Return sizes times curves (k, m) of a shape at times t (k, 1)."""
    shape = _SHAPES[name]
    # the dear part: solutions that differ in other numbers, as slopes need, share it
    bent = np.stack([numbers[number] for number in shape.curved])
    own, which = np.unique(bent, axis=1, return_inverse=True)
    which = which.ravel()
    curves = shape.curves(t - center, t, dict(zip(shape.curved, own, strict=True)), step)
    course = np.zeros((len(t), len(which)))
    for size, curve in zip(shape.sizes, curves, strict=True):
        # unlike an index in brackets this keeps the order in memory in which times follow
        moved = np.take(curve, which, axis=1)
        if size not in shape.curved:
            moved *= numbers[size]
        course += moved
    return course


@dataclass(frozen=True)
class _Shape:
    """A course of a factor: a curve times each size, or bent by a size that is in ``curved``."""

    sizes: tuple[str, ...]
    others: dict[str, float]
    curved: tuple[str, ...]
    curves: Callable[[FloatArray, FloatArray, Numbers, float], tuple[FloatArray, ...]]


def _step(_: FloatArray, t: FloatArray, numbers: Numbers, step: float) -> tuple[FloatArray, ...]:
    return (0.5 * (1 + np.tanh((t - numbers["location"]) / step)),)


def _ramp(_: FloatArray, t: FloatArray, numbers: Numbers, step: float) -> tuple[FloatArray, ...]:
    return (np.clip((t - numbers["location"]) / numbers["duration"], 0, 1),)


def _logistic(
    _: FloatArray, t: FloatArray, numbers: Numbers, step: float
) -> tuple[FloatArray, ...]:
    # tanh, unlike exp, does not overflow
    return (0.5 * (1 + np.tanh((t - numbers["location"]) / (2 * numbers["width"]))),)


def _exponential(
    centred: FloatArray, _: FloatArray, numbers: Numbers, step: float
) -> tuple[FloatArray, ...]:
    # a factor of e^50 breaks any simulation; beyond there is overflow only
    return (np.expm1(np.clip(numbers["rate"] * centred, -50, 50)),)


def _periodic(
    centred: FloatArray, _: FloatArray, numbers: Numbers, step: float
) -> tuple[FloatArray, ...]:
    angle = 2 * np.pi * centred / numbers["period"]
    return np.sin(angle), np.cos(angle)


_SHAPES = {
    "step": _Shape(("amount",), {"location": 0.0}, ("location",), _step),
    "ramp": _Shape(
        ("amount",), {"location": 0.0, "duration": 1.0}, ("location", "duration"), _ramp
    ),
    "logistic": _Shape(
        ("amount",), {"location": 0.0, "width": 1.0}, ("location", "width"), _logistic
    ),
    "exponential": _Shape(("rate",), {}, ("rate",), _exponential),
    "periodic": _Shape(("sine", "cosine"), {"period": 1.0}, ("period",), _periodic),
}
