"""Values of which only a bound was recorded, and values that were rounded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from hybridsurrogate.arguments import as_real
from hybridsurrogate.exceptions import did_you_mean
from hybridsurrogate.likelihoods.base import LIKELIHOODS, MAX_Z, Likelihood
from hybridsurrogate.likelihoods.student_t import OfPlain, of_plain
from hybridsurrogate.types import FloatArray

_ROOT = float(np.sqrt(2 * np.pi))


@dataclass(frozen=True)
class Censored(OfPlain):
    """A likelihood of values that an instrument cannot report beyond its limits.

    A y at the lower limit or below stands for "not more than the limit", one at the upper limit or
    above for "not less". Such a row counts with the probability of that (Tobin 1958, Econometrica
    26:24); with ``step`` all others count with the probability of what is rounded to them.

    Predicted means are those of the value itself, which may lie beyond a limit. Draws and intervals
    are those of what is recorded. Where each row has a limit, `of_rows` marks the rows beyond
    theirs; draws and intervals of new rows are then those of the value itself, unless their limits
    are given, as in ``score(X, y, below=limits)``.

    Parameters
    ----------
    base : str or Likelihood, default="normal"
        "normal", "lognormal", "student-t", "poisson" or "negative-binomial".
    below, above : float, tuple of float or None, default=None
        Limits in the units of y; None: there is none. Of several, see `of_rows`: a y that equals
        one of them stands for "not more", or "not less", than this one.
    step : float or None, default=None
        Recorded values are rounded to multiples of it; None: they are not.

    Raises
    ------
    ValueError
        In ``fit``: for limits that are not in order or leave no measured value between them, for a
        step that is not positive, and for a likelihood without distribution function.

    Examples
    --------
    A value below a limit of 1 where 3 is expected, with a noise of 2:

    >>> import numpy as np
    >>> from hybridsurrogate.likelihoods import Censored
    >>> limited = Censored(below=1.0)
    >>> eta, sigma = np.array([[3.0]]), np.array([[2.0]])
    >>> np.exp(limited.log_density(np.array([1.0]), eta, sigma)).round(3)
    array([[0.159]])
    >>> limited.side(np.array([0.4, 1.7])).tolist()
    [-1, 0]
    """

    base: str | Likelihood = "normal"
    below: float | tuple[float, ...] | None = None
    above: float | tuple[float, ...] | None = None
    step: float | None = None

    @classmethod
    def of_rows(
        cls,
        y: ArrayLike,
        below: ArrayLike | None = None,
        above: ArrayLike | None = None,
        base: str | Likelihood = "normal",
        step: float | None = None,
    ) -> tuple[FloatArray, Censored]:
        """Return y with rows beyond their own limits marked, and the likelihood that knows marks.

        Call it once with all rows, before some are held out. A mark is the row's limit in place of
        its y; a measured value that happens to equal a mark is moved to the next number.

        Parameters
        ----------
        y : array-like of shape (n,)
            Values; of a row beyond its limit anything on that side, such as the limit itself. NaN
            stays.
        below, above : float, array-like of shape (n,) or None, default=None
            The limit of each row, in units of y; NaN: it has none.
        base : str or Likelihood, default="normal"
        step : float or None, default=None
            As of the class.

        Returns
        -------
        y : ndarray of shape (n,)
        likelihood : Censored

        Raises
        ------
        ValueError
            For limits of another length, that are infinite or not in order, or beyond which all
            rows lie.

        Examples
        --------
        >>> from hybridsurrogate.likelihoods import Censored
        >>> y, limited = Censored.of_rows([0.5, 0.7, 2.0], below=[0.5, 0.2, 1.0])
        >>> limited.below, limited.side(y).tolist()
        ((0.5,), [-1, 0, 0])
        """
        values = np.asarray(y, dtype=float)
        if values.ndim != 1:
            raise ValueError(
                f"y must have shape (n,), got {values.shape}: limits are of one output."
            )
        low, high = limits_of_rows(len(values), below, above)
        there = ~np.isnan(values)
        if there.any() and np.all(((values <= low) | (values >= high))[there]):
            raise ValueError(
                f"None of the {there.sum()} values lies between its limits: check the limits and "
                "their unit."
            )
        out, lower, upper = _marked(values, low, high)
        return out, cls(base, lower, upper, step)

    @classmethod
    def of_new_rows(
        cls, y: FloatArray, likelihood: Likelihood, below: ArrayLike | None, above: ArrayLike | None
    ) -> tuple[FloatArray, Censored]:
        """Return new y with rows beyond their own limits marked, and the likelihood of these.

        Parameters
        ----------
        y : ndarray of shape (n,)
        likelihood : Likelihood
            Of the fit: limits that it has stay where none is given.
        below, above : float, array-like of shape (n,) or None
            As in `of_rows`; all rows may lie beyond theirs.
        """
        known = likelihood if isinstance(likelihood, cls) else cls(likelihood)
        y, lower, upper = _marked(y, *limits_of_rows(len(y), below, above))
        new = replace(known, below=lower, above=upper)
        if below is None:
            new = replace(new, below=known.below)
        return y, new if above is not None else replace(new, above=known.above)

    @property
    def plain(self) -> Likelihood:  # type: ignore[override]
        """The likelihood of values that are recorded as they are."""
        if isinstance(self.base, Likelihood):
            return self.base
        if self.base not in LIKELIHOODS:
            raise ValueError(
                f"Censored takes one of {sorted(LIKELIHOODS)} or a Likelihood object, got "
                f"{self.base!r}.{did_you_mean(self.base, LIKELIHOODS)}"
            )
        return LIKELIHOODS[self.base]

    @property
    def name(self) -> str:  # type: ignore[override]
        """That of the plain likelihood, with limits."""
        return f"{self.plain.name} with limits"

    has_scale = of_plain("has_scale")
    scales_noise = of_plain("scales_noise")
    means_as_runs = of_plain("means_as_runs")

    @property
    def of_runs(self) -> Likelihood:
        """The plain likelihood: a simulation has no limits."""
        return self.plain

    def check(self, y: FloatArray, source: str = "measured") -> None:
        """Raise ValueError for limits without sense and for y that is none within them."""
        if source == "simulated":
            self.plain.check(y, source)
            return
        for word in ("below", "above", "step"):
            value = getattr(self, word)
            if word != "step" and np.ndim(value) and not isinstance(value, tuple):
                raise ValueError(
                    f"{word} of Censored is one limit. Limits of rows: "
                    f"y, likelihood = hs.Censored.of_rows(y, {word}=limits)."
                )
            for one in value if isinstance(value, tuple) else (value,) * (value is not None):
                as_real(one, word)
        low, high = self._limits
        if not low < high:
            raise ValueError(f"Censored needs below < above, got below={low:g}, above={high:g}.")
        if self.step is not None and not self.step > 0:
            raise ValueError(f"Censored needs a step that is positive, got {self.step!r}.")
        one = np.array([[max(low, 1.0) if np.isfinite(low) else min(high, 1.0)]])
        self.plain.log_below(one[0], self.plain.link(one), np.ones((1, 1)))
        self.plain.check(self._within(y), source)

    def check_training(self, y: FloatArray, source: str = "measured") -> None:
        """Also raise ValueError where no value lies between the limits."""
        super().check_training(y, source)
        if source != "simulated" and len(y) and np.all(self.side(y) != 0):
            low, high = self._limits
            between = f"{low:g} and {high:g} " if np.isfinite(low) or np.isfinite(high) else ""
            raise ValueError(
                f"None of the {len(y)} {source} values lies between the limits {between}"
                "of Censored: check the limits and their unit."
            )

    def side(self, y: FloatArray) -> NDArray[np.int_]:
        """Return -1 for values at the lower limit or below, 1 for those at the upper, else 0."""
        low, high = self._limits
        is_below, is_above = y <= low, y >= high
        if isinstance(self.below, tuple):
            is_below = np.isin(y, self.below)
        if isinstance(self.above, tuple):
            is_above = np.isin(y, self.above)
        return np.where(is_below, -1, np.where(is_above, 1, 0))

    def working(self, y: FloatArray) -> FloatArray:
        """Return y on the scale of eta, no further than a limit."""
        return self.plain.working(self._within(y))

    def working_runs(self, y: FloatArray) -> FloatArray:
        """Return outputs of runs, which have no limits, on the scale of eta."""
        return self.plain.working_runs(y)

    def scatter(self, errors: FloatArray, y: FloatArray) -> FloatArray:
        """Return known errors on the scale of eta; those of limits are relative to these."""
        return self.plain.scatter(errors, self._within(y))

    def log_density(self, y: FloatArray, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the log density of each y, or the log probability of all that it stands for."""
        y, plain = self._within(y), self.plain
        side = self.side(y)
        exact = self._rounded(y, eta, sigma) if self.step else plain.log_density(y, eta, sigma)
        if not side.any():
            return exact
        y, eta, sigma, out, side = np.broadcast_arrays(y, eta, sigma, exact, side)
        out = out.copy()
        for sign, of in ((-1, plain.log_below), (1, plain.log_above)):
            # whole rows: a likelihood may hold something of each draw
            rows = (side == sign).reshape(-1, side.shape[-1]).any(axis=0)
            tail = of(y[..., rows], eta[..., rows], sigma[..., rows])
            out[..., rows] = np.where(side[..., rows] == sign, tail, out[..., rows])
        return out

    def _rounded(self, y: FloatArray, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return log(F(y + step / 2) - F(y - step / 2)), from the tail in which it is small."""
        assert self.step is not None
        low, high = y - self.step / 2, y + self.step / 2
        below, above = self.plain.log_below, self.plain.log_above
        left = eta > self.plain.working(np.maximum(y, self.step / 4) if self.log_scale else y)
        whole = np.where(left, below(high, eta, sigma), above(low, eta, sigma))
        less = np.where(left, below(low, eta, sigma), above(high, eta, sigma))
        with np.errstate(divide="ignore", invalid="ignore"):
            return whole + np.log(-np.expm1(less - whole))

    def information(self, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the Fisher information of each row, limits included.

        Of normal noise at a distance a of the lower limit, in standard deviations:
        ``1 - Phi(a) + a phi(a) + phi(a)^2 / Phi(a)`` over sigma^2; alike at the upper one.
        """
        if self.step or not self.plain.gaussian:
            return super().information(eta, sigma)
        low, high = ((end - eta) / sigma for end in self._limits_of_eta)
        out = special.ndtr(high) - special.ndtr(low)
        for a, sign in ((low, 1.0), (high, -1.0)):
            a = np.clip(a, -MAX_Z, MAX_Z)
            density = np.exp(-0.5 * a**2) / _ROOT
            out = out + sign * a * density + density * np.exp(_log_hazard(sign * a))
        return np.maximum(out, np.finfo(float).tiny) / np.square(sigma)

    def derivatives(
        self, y: FloatArray, eta: FloatArray, sigma: FloatArray, width: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Return slope and curvature of the log density in eta.

        Of normal noise beyond a limit at a distance a: with the inverse Mills ratio
        ``r = phi(a) / Phi(a)`` they are ``-r / sigma`` and ``r (r + a) / sigma^2``.
        """
        if self.step or not self.plain.gaussian:
            return super().derivatives(y, eta, sigma, width)
        slope, curvature = self.plain.derivatives(self._within(y), eta, sigma, width)
        side = self.side(y)
        if not side.any():
            return slope, curvature
        a = -side * (self.working(y) - eta) / sigma
        ratio = np.exp(_log_hazard(a))
        bend = np.maximum(ratio * (ratio + a), np.finfo(float).tiny)
        beyond = side != 0
        return (
            np.where(beyond, side * ratio / sigma, slope),
            np.where(beyond, bend / np.square(sigma), curvature),
        )

    def variance(self, eta: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the variance of the value itself."""
        return self.plain.variance(eta, sigma)

    def sample(
        self, eta: FloatArray, sigma: FloatArray, random_state: np.random.RandomState
    ) -> FloatArray:
        """Draw what is recorded once for each eta."""
        y = self.plain.sample(eta, sigma, random_state)
        if self.step:
            y = self.step * np.round(y / self.step)
        return self._within(y)

    @property
    def _limits(self) -> tuple[float, float]:
        """The limits that all rows have; marks of rows are none."""
        low = -np.inf if self.below is None or isinstance(self.below, tuple) else self.below
        high = np.inf if self.above is None or isinstance(self.above, tuple) else self.above
        return float(low), float(high)

    @property
    def _limits_of_eta(self) -> list[FloatArray]:
        ends = [np.array(end) for end in self._limits]
        return [self.plain.link(end) if np.isfinite(end) else end for end in ends]

    def _within(self, y: FloatArray) -> FloatArray:
        low, high = self._limits
        y = np.clip(np.asarray(y, dtype=float), low, high)
        if not self.plain.means_as_runs:
            return y
        # the last whole number beyond a limit
        return np.where(y <= low, np.floor(low), np.where(y >= high, np.ceil(high), y))


def limits_of_rows(
    n: int, below: ArrayLike | None, above: ArrayLike | None, outputs: Sequence[str] = ()
) -> tuple[FloatArray, FloatArray]:
    """Return lower and upper limits (n,) of rows, infinite where there is none.

    Of several outputs (n, k), from as many or from one limit of each output. Raises ValueError for
    another shape, and for limits that are not in order or that nothing can reach.
    """
    shape, ends = (n, len(outputs)) if outputs else (n,), []
    for limits, word, none in ((below, "below", -np.inf), (above, "above", np.inf)):
        values = np.asarray(np.full(shape, np.nan) if limits is None else limits, dtype=float)
        if values.shape not in (shape[1:], shape):
            each = f"each of the {n} rows"
            if outputs:
                each = f"each of the outputs {', '.join(outputs)}, or for each value, {shape}"
            raise ValueError(f"{word} must have one limit for {each}, got {values.shape}.")
        if np.any(values == -none):
            raise ValueError(f"{word} must hold finite limits; NaN where a row has none.")
        ends.append(np.broadcast_to(np.where(np.isnan(values), none, values), shape))
    low, high = ends
    if len(bad := np.argwhere(low >= high)):
        k = tuple(bad[0])
        raise ValueError(
            f"below must be less than above in each row; row {k[0] + 1} has {low[k]:g} and "
            f"{high[k]:g}."
        )
    return low, high


def _marked(
    values: FloatArray, low: FloatArray, high: FloatArray
) -> tuple[FloatArray, tuple[float, ...] | None, tuple[float, ...] | None]:
    """Return values with limits in the place of what lies beyond, and the lower and upper marks.

    A value between its limits that happens to equal a mark is moved to the next number.
    """
    is_below, is_above = values <= low, values >= high
    out = np.clip(values, low, high)
    marks = [np.unique(one) for one in (low[is_below], high[is_above])]
    exact = ~is_below & ~is_above
    for known, end in zip(marks, (np.inf, -np.inf), strict=True):
        same = exact & np.isin(out, known)
        out[same] = np.nextafter(out[same], end)
    lower, upper = (tuple(known.tolist()) or None for known in marks)
    return out, lower, upper


def _log_hazard(a: FloatArray) -> FloatArray:
    """Return log(phi(a) / Phi(a))."""
    return np.asarray(-0.5 * np.square(a) - np.log(_ROOT) - special.log_ndtr(a))
