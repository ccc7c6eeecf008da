"""Noise that is not the same everywhere: over a column, the output, experiments, outputs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from hybridsurrogate.effects.base import (
    SIMULATED,
    Cause,
    Context,
    Declared,
    FloatArray,
    Rows,
    quantiles,
)
from hybridsurrogate.effects.context import UNKNOWN, UNMEASURED, Axis, OutputScale
from hybridsurrogate.effects.expressions import Code
from hybridsurrogate.effects.inputs import at_levels
from hybridsurrogate.effects.over_column import AtLevel, OverColumn
from hybridsurrogate.effects.registry import Form, over_columns, register
from hybridsurrogate.numerics import hilbert
from hybridsurrogate.priors import frozen
from hybridsurrogate.simulation.outputs import OUTPUT
from hybridsurrogate.types import Prior

# standard deviation of the log of a ratio: one output may be read fifty times as well as another
_RATIO_SD = 2.0
# correlations nearer to one are singular to rounding
_MOST_CORRELATED = 1 - 1e-9
# beyond the measured rows, in spans: as far as curves of any shape go on
_BEYOND = (hilbert.BOUNDARY - 1) / 2


@dataclass(eq=False, repr=False)
class OutputNoise(Declared):
    """Separate noise for each of several outputs, relative to that of the first.

    Outputs are in units of their measured standard deviations, and ratios log-normal around one.

    Parameters
    ----------
    outputs : sequence of str
    ratios : sequence of float or None, default=None
        Known ratios, the first one; None: inferred.

    Examples
    --------
    >>> import numpy as np
    >>> from hybridsurrogate.effects.noise.noise import OutputNoise
    >>> noise = OutputNoise(("level", "flow"))
    >>> list(noise.parameters)
    ['noise of flow']
    >>> noise.noise({"output_of_row": np.array([0.0, 1.0])}, {"noise of flow": np.full(2, 3.0)})
    array([1., 3.])
    """

    kind = "noise-of-outputs"

    outputs: Sequence[str]
    ratios: Sequence[float] | None = None

    def priors_by_name(self) -> Mapping[str, Prior]:
        """Return the ratios of the other outputs, unless they are known."""
        if self.ratios is not None:
            return {}
        return {f"noise of {name}": frozen(stats.lognorm, _RATIO_SD) for name in self.outputs[1:]}

    def noise(self, X: Rows, theta: Rows) -> FloatArray:
        """Return the ratio of each row's output."""
        which = X[OUTPUT].astype(np.intp)
        if self.ratios is not None:
            return np.asarray(self.ratios, dtype=float)[which]
        each = np.stack([np.ones(len(which)), *(theta[name] for name in self.parameters)])
        return np.asarray(each[which, np.arange(len(which))])

    def code(self) -> Code:
        """Return the cause as Python."""
        return Code("", does="nothing")

    def log_prior(self) -> float:
        """Return the log prior density of known ratios, of their logarithms."""
        assert self.ratios is not None
        return float(np.sum(stats.norm.logpdf(np.log(self.ratios[1:]), scale=_RATIO_SD)))


@dataclass(eq=False, repr=False)
class OutputCorrelation(Declared):
    """Errors of several outputs that are correlated within a measurement; part of the data.

    One dilution, one temperature or one calibration, and both outputs of a row are too high
    together. The errors of a row are normal, each output with its own standard deviation, and their
    correlations are estimated. A priori all correlation matrices are equally probable (Lewandowski,
    Kurowicka and Joe 2009, Journal of Multivariate Analysis 100:1989, with eta = 1). Rows are
    independent of each other.

    Give it to an estimator, ``effects=[hs.OutputCorrelation()]``. Where the covariances are known,
    pass these as ``y_err`` of shape (n, k, k) or (k, k) instead.

    Parameters
    ----------
    correlation : frozen scipy.stats distribution or None, default=None
        Prior of each partial correlation, within (-1, 1): given the outputs before both, so that
        those of the first output, and of two outputs, are correlations. None: as above, of two
        outputs uniform.
    outputs : tuple of str, default=()
        Names; empty: all.
    fixed : tuple of float or None, default=None
        Partial correlations that are known, in the order of `pairs`.
    ratios : tuple of float or None, default=None
        Standard deviations that are known, relative to the first; None: those of the other effects.

    Raises
    ------
    ValueError
        When a model is fitted: for a single output, and under a likelihood that is not normal on
        its scale.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> errors = hs.OutputCorrelation(outputs=("height", "flow"))
    >>> errors.matrices({"correlation": np.array([0.8])}, 1).round(3).tolist()
    [[[1.0, 0.8], [0.8, 1.0]]]
    """

    kind = "correlated-errors"
    by_output = True

    correlation: Prior | None = None
    outputs: tuple[str, ...] = ()
    fixed: tuple[float, ...] | None = None
    ratios: tuple[float, ...] | None = None

    def prepare(self, context: Context) -> Cause:
        """Fill in the outputs; raise ValueError where there is one, or no normal likelihood."""
        if len(context.outputs) < 2:
            raise ValueError(
                "OutputCorrelation is of the errors of several outputs, and there is one. Errors "
                'that rows share: hs.SharedErrors("batch").'
            )
        if not context.gaussian:
            raise ValueError(
                "OutputCorrelation needs a likelihood that is normal on its scale: "
                'likelihood="normal" or "lognormal".'
            )
        return self.filled(outputs=tuple(context.outputs))

    @property
    def pairs(self) -> list[tuple[int, int]]:
        """Positions of all pairs of outputs, those of the first first."""
        k = len(self.outputs)
        return [(i, j) for i in range(k) for j in range(i + 1, k)]

    def priors_by_name(self) -> Mapping[str, Prior]:
        """Return the prior of each partial correlation, given the outputs before both."""
        if self.fixed is not None:
            return {}
        if len(self.outputs) == 2:
            return {"correlation": self._prior(0)}
        names = self.outputs
        return {
            f"{'partial ' * (i > 0)}correlation of {names[i]} and {names[j]}": self._prior(i)
            for i, j in self.pairs
        }

    def _prior(self, i: int) -> Prior:
        if self.correlation is not None:
            return self.correlation
        shape = 1 + (len(self.outputs) - 2 - i) / 2
        return frozen(stats.beta, shape, shape, loc=-1, scale=2)

    def matrices(self, theta: Rows, n: int) -> FloatArray:
        """Return the correlations between all outputs for n draws, (n, k, k), or (1, k, k)."""
        values = list(self.fixed or (theta[name] for name in self.parameters))
        k, n = len(self.outputs), n if self.fixed is None else 1
        root: FloatArray = np.zeros((n, k, k))
        left = np.ones((n, k))
        for (i, j), value in zip(self.pairs, values, strict=True):
            # as far from one as an inverse bears
            within = np.clip(np.asarray(value), -_MOST_CORRELATED, _MOST_CORRELATED)
            root[:, j, i] = within * np.sqrt(left[:, j])
            left[:, j] -= root[:, j, i] ** 2
        root[:, range(k), range(k)] = np.sqrt(left)
        return root @ np.swapaxes(root, 1, 2)

    def at_estimate(self, matrix: FloatArray, ratios: tuple[float, ...] | None) -> Cause:
        """Return the same with known correlations (k, k) and ratios of standard deviations."""
        root = np.linalg.cholesky(matrix)
        left = np.maximum(1 - np.cumsum(root**2, axis=1) + root**2, np.finfo(float).tiny)
        partial = [float(root[j, i] / np.sqrt(left[j, i])) for i, j in self.pairs]
        return self.filled(fixed=tuple(partial), ratios=ratios)

    def estimates(self, theta: Rows, coefficients: Rows) -> dict[str, FloatArray]:
        """Return the correlation of each pair."""
        if self.fixed is not None:
            return {}
        found = self.matrices(theta, len(next(iter(theta.values()))))
        if len(self.outputs) == 2:
            return {"correlation": found[:, 0, 1]}
        names = self.outputs
        return {f"correlation of {names[i]} and {names[j]}": found[:, i, j] for i, j in self.pairs}

    def code(self) -> Code:
        """Return the cause as Python."""
        return Code("", does="nothing")

    def formula(self, values: Mapping[str, float]) -> str:
        """Return the extended simulation in words."""
        return "simulation, measured with errors that are correlated between outputs"


@dataclass(eq=False, repr=False)
class Noise(OverColumn):
    """Noise whose standard deviation grows or shrinks over a column; the simulation is right.

    The standard deviation is ``sigma exp(slope u)`` with u the column centred at its mean over the
    measured rows and divided by half its span: the log-linear dispersion model of Cook and Weisberg
    (1983, Biometrika 70:1). The factor has geometric mean one over the measured rows, so sigma
    keeps its meaning. The slope is standard normal: between the ends of the measured rows the noise
    changes by a factor of exp(2 slope), mostly less than 50. Beyond a quarter of the span from
    either end it changes no more: an exponential without end says what no data have shown. On a
    logarithmic scale of the output the noise is relative.

    Parameters
    ----------
    column : str
        Any measured column.
    slope : frozen scipy.stats distribution or None, default=None
        Prior of the slope.
    axis : Axis
        Where the measured rows lie; `prepare` looks.

    Notes
    -----
    Rows held out beyond, 171 new cases whose noise changes by a factor of 2, 4 or 7: it costs 0.04
    (standard error 0.01) in the mean log density of a row where the true noise goes on for ever,
    and gains 0.07 (0.01) where it stays as it is at the end, 0.15 (0.02) where it turns back.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> from hybridsurrogate.effects.context import Axis
    >>> growing = hs.Noise("t", axis=Axis.of([0.0, 1.0, 2.0]))
    >>> growing.noise({"t": np.array([0.0, 1.0, 2.0])}, {"slope": np.log(2)}).round(3).tolist()
    [0.5, 1.0, 2.0]
    >>> growing.noise({"t": np.array([2.5, 9.0])}, {"slope": np.log(2)}).round(3).tolist()
    [2.828, 2.828]
    """

    kind = "noise"
    unknowns = ("slope",)

    column: str
    slope: Prior | None = None
    axis: Axis = UNKNOWN

    @property
    def pivot(self) -> float:
        """The mean of the measured rows."""
        return self.axis.mean

    @property
    def ends(self) -> tuple[float, float]:
        """The places beyond which it stays the same."""
        reach = _BEYOND * self.axis.span
        return self.axis.origin - reach, float(self.axis.rows[-1]) + reach

    def prepare(self, context: Context) -> Cause:
        """Fill in the axis and the prior."""
        return self.filled(axis=self.along(context), slope=self.slope or frozen(stats.norm))

    def noise(self, X: Rows, theta: Rows) -> FloatArray:
        """Return the factor on the noise scale."""
        within = {self.column: np.clip(X[self.column], *self.ends)}
        return np.exp(theta["slope"] * self.scaled(within))

    def estimates(self, theta: Rows, coefficients: Rows) -> dict[str, FloatArray]:
        """Return growth of log sigma per unit of the column, and the factor over the whole span."""
        return {"slope": 2 * theta["slope"] / self.axis.span, "ratio": np.exp(2 * theta["slope"])}

    def code(self) -> Code:
        """Return the cause as Python."""
        return Code(
            "{sigma} * np.exp({slope} * (np.clip({x}, {first}, {last}) - {center}))",
            {"slope": "1 / {x}"},
            {"x": self.column},
            {"center": self.pivot, "first": self.ends[0], "last": self.ends[1]},
            does="scatters",
            name="noise_sd",
        )

    def formula(self, values: Mapping[str, float]) -> str:
        """Return the extended simulation in words."""
        return (
            f"simulation, with noise that changes by a factor of {values['ratio']:.4g} over "
            f"{self.axis.span:.4g} units of {self.column}"
        )


register(
    Form(
        "noise",
        Noise,
        over_columns(Noise),
        meaning="the scatter of the measurements changes over {column}",
        least_rows=8,
        headline="The scatter of {output} changes over {column}",
    )
)


@dataclass(eq=False, repr=False)
class NoiseAtLevel(AtLevel):
    """Noise that is larger or smaller where a column has one value; the simulation is right.

    One bad batch, one bad sensor: the standard deviation is ``ratio sigma`` there, and sigma
    everywhere else. The ratio is log-normal around one, mostly between 1/7 and 7.

    Parameters
    ----------
    column : str
        A measured column that labels experiments.
    level : float or str
        The value, or the name, that is meant.
    labels : tuple of str or None, default=None
        Names in the column; `prepare` looks.
    ratio : frozen scipy.stats distribution or None, default=None
        Prior of the ratio.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> bad = hs.NoiseAtLevel("batch", 3)
    >>> bad.noise({"batch": np.array([1.0, 3.0])}, {"ratio": np.full(2, 4.0)}).tolist()
    [1.0, 4.0]
    """

    kind = "noise"
    unknowns = ("ratio",)

    column: str
    level: float | str
    ratio: Prior | None = None
    labels: tuple[str, ...] | None = None

    def prepare(self, context: Context) -> Cause:
        """Fill in the prior; raise ValueError where the level is never measured."""
        return self.filled(
            level=context.level(self.column, self.level),
            ratio=self.ratio or frozen(stats.lognorm, 1.0),
            labels=context.names.get(self.column),
        )

    def noise(self, X: Rows, theta: Rows) -> FloatArray:
        """Return the factor on the noise scale."""
        return np.where(self.here(X), theta["ratio"], 1.0)

    def code(self) -> Code:
        """Return the cause as Python."""
        expression = "{sigma} * np.where({x} == {level}, {ratio}, 1)"
        return self.code_at_level(expression, {"ratio": "1"}, does="scatters", name="noise_sd")

    def formula(self, values: Mapping[str, float]) -> str:
        """Return the extended simulation in words."""
        there = f"where {self.column} = {self.name_of(self.level)}"
        return f"simulation, with {values['ratio']:.4g} times the noise {there}"


register(
    Form(
        "noise: level",
        NoiseAtLevel,
        lambda context: at_levels(NoiseAtLevel, context, context.labels),
        meaning=(
            "the measurements scatter more, or less, in one experiment of {target} than in the "
            "others"
        ),
        least_rows=12,
        headline="{output} scatters differently where {target} is {level}",
    )
)


# an output near zero still has this share of its usual size
_SMALLEST_SIZE = 0.05
# an even spread over the output reaches about this many standard deviations to either side
_REACH_SD = 2.0


@dataclass(eq=False, repr=False)
class NoiseOfMean(Declared):
    """Noise whose standard deviation is a power of the output's size; the simulation is right.

    The standard deviation is ``sigma (m / size)^exponent`` with
    ``m = sqrt(eta^2 + (size / 20)^2)``: the power-of-the-mean model (Carroll and Ruppert 1988,
    Transformation and Weighting in Regression, chapter 2), kept from zero where eta passes it. eta
    is the simulation at the row, without what other causes add; ``size`` is the root mean square of
    the measured output, so sigma is the noise of an output of that size. Exponent 1 is a relative
    error, 1/2 that of counts, 0 the same noise everywhere. On a logarithmic scale m is the output
    itself, ``exp(eta - center)``.

    The exponent is normal around 0, with standard deviation 1, or more where the output moves by a
    small share of its size only: there the noise at the ends still may differ by a factor.

    An emulator's coefficients are fixed at their estimate from the runs wherever eta sets the
    noise, so that everything else stays conditionally Gaussian (pseudo-likelihood; Davidian and
    Carroll 1987, Journal of the American Statistical Association 82:1079).

    Parameters
    ----------
    exponent : frozen scipy.stats distribution or None, default=None
        Prior of the exponent.
    measured : OutputScale
        Where the measured output lies; `prepare` looks.

    Examples
    --------
    >>> import numpy as np, hybridsurrogate as hs
    >>> from hybridsurrogate.effects.context import OutputScale
    >>> relative = hs.NoiseOfMean(measured=OutputScale(location=0.0, spread=2.0))
    >>> rows = {hs.SIMULATED: np.array([0.0, 2.0, 20.0])}
    >>> relative.noise(rows, {"exponent": 1.0}).round(2).tolist()
    [0.05, 1.0, 10.0]
    """

    kind = "noise"
    unknowns = ("exponent",)
    meaning = "the scatter of the measurements changes with the size of {output}"
    follows_mean = True
    variant = "mean"
    name = "noise(output)"

    exponent: Prior | None = None
    measured: OutputScale = UNMEASURED

    def prepare(self, context: Context) -> Cause:
        """Fill in the usual size of the output and the prior."""
        measured = self.measured if self.measured.is_known else context.measured
        relative = measured.spread if measured.is_log else measured.spread / measured.size
        prior = self.exponent or frozen(stats.norm, scale=max(1.0, 1 / (_REACH_SD * relative)))
        return self.filled(exponent=prior, measured=measured)

    def grid(self) -> dict[str, FloatArray]:
        """Return nine quantiles of the exponent."""
        return {"exponent": quantiles(self.exponent, 9)}

    def noise(self, X: Rows, theta: Rows) -> FloatArray:
        """Return the factor on the noise scale."""
        # an exponent far out would overflow where the simulation is far off: no data are there
        return np.exp(np.clip(theta["exponent"] * self._log_size(X[SIMULATED]), -50, 50))

    def _log_size(self, eta: FloatArray) -> FloatArray:
        if self.measured.is_log:
            return eta - self.measured.location
        return 0.5 * np.log((eta / self.measured.size) ** 2 + _SMALLEST_SIZE**2)

    def estimates(self, theta: Rows, coefficients: Rows) -> dict[str, FloatArray]:
        """Return the exponent, and the factor between a usual large output and a small one.

        They are one standard deviation of the output above and below its mean.
        """
        middle, spread = self.measured.location, self.measured.spread
        ends = np.array([middle - spread, middle + spread])
        if not self.measured.is_log:
            # of an output of both signs the small sizes are near zero
            ends = np.maximum(abs(middle) + np.array([-1.0, 1.0]) * spread, 0.0)
        low, high = np.sort(self._log_size(ends))
        exponent = np.asarray(theta["exponent"])
        return {"exponent": exponent, "ratio": np.exp(exponent * (high - low))}

    def code(self) -> Code:
        """Return the cause as Python."""
        factor = "(({simulated} / {size}) ** 2 + {floor}**2) ** ({exponent} / 2)"
        constants = {"size": self.measured.size, "floor": _SMALLEST_SIZE}
        if self.measured.is_log:
            factor = "np.exp({exponent} * ({simulated} - {center}))"
            constants = {"center": self.measured.location}
        return Code(
            f"{{sigma}} * {factor}",
            {"exponent": "1"},
            constants=constants,
            does="scatters",
            name="noise_sd",
        )

    def formula(self, values: Mapping[str, float]) -> str:
        """Return the extended simulation in words."""
        return (
            "simulation, with noise proportional to the size of the output to the power of "
            f"{values['exponent']:.3g}"
        )


register(
    Form(
        "noise: mean",
        NoiseOfMean,
        lambda context: [NoiseOfMean()],
        least_rows=8,
        headline="The scatter of {output} depends on its size",
    )
)
