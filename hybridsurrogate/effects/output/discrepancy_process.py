"""The catch-all: a smooth discrepancy of unknown shape (Kennedy and O'Hagan 2001)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy import stats

from hybridsurrogate.effects.base import Cause, Context, Declared, FloatArray, Rows
from hybridsurrogate.effects.code import Code
from hybridsurrogate.effects.registry import Form, register
from hybridsurrogate.numerics import hilbert
from hybridsurrogate.priors import frozen
from hybridsurrogate.types import Prior

# basis functions an input: enough for the shortest length scale below (Riutort-Mayol et al. 2023,
# Statistics and Computing 33:17, eq. 17: m >= 1.75 boundary / length scale); seven for each of two
# inputs follow lengths from 0.375 on
_N_BASIS, _N_BASIS_EACH = {1: 24, 2: 7}, 10
# places of the table of a curve, interpolated by lines, and of each side of a surface, by cubics
_PLACES = {1: 121, 2: 25}


class GaussianProcessDiscrepancy(Declared):
    """A Gaussian process over the simulation's inputs, by a Hilbert-space basis.

    Squared-exponential kernel with one length scale on inputs scaled to [-1, 1]; the basis is a
    tensor product for up to two inputs and a sum over inputs beyond (Solin and Sarkka 2020,
    Statistics and Computing 30:419).

    Parameters
    ----------
    ranges : dict of name to (low, high) or None, default=None
        Ranges that are scaled to [-1, 1]; the process lives on one and a half times them and is
        zero beyond. Long length scales are short of variance towards the ends of the range (a
        length of 1 has 63 % of the amplitude there). None: the measured ranges.
    length_scale : frozen scipy.stats distribution or None, default=None
        Prior on the scaled inputs. None: log-uniform from 0.15 (0.3 for several inputs) to 2.
    amplitude : frozen scipy.stats distribution or None, default=None
        Prior of the standard deviation of the process on the scale of eta. None: fixed at three
        times the spread of the output.

    Examples
    --------
    >>> from scipy.stats import uniform
    >>> import hybridsurrogate as hs
    >>> curve = hs.GaussianProcessDiscrepancy({"t": (0, 4)}, uniform(0.2, 1))
    >>> curve.columns({"t": np.linspace(0, 4, 9)}, {"length_scale": np.full(9, 0.5)}).shape
    (9, 24)
    """

    kind = "unexplained"
    is_process = True

    def __init__(
        self,
        ranges: Mapping[str, tuple[float, float]] | None = None,
        length_scale: Prior | None = None,
        amplitude: Prior | None = None,
    ):
        self.ranges = ranges
        self.length_scale: Prior = length_scale
        self.amplitude = amplitude

    def prepare(self, context: Context) -> Cause:
        """Fill in the measured ranges of the inputs and the prior of the length scale."""
        ranges = self.ranges
        if ranges is None:
            ranges = {
                name: (float(context.X[name].min()), float(context.X[name].max()))
                for name in context.inputs
            }
        prior = self.length_scale
        if prior is None:
            prior = frozen(stats.loguniform, 0.15 if len(ranges) == 1 else 0.3, 2.0)
        return self.filled(ranges=ranges, length_scale=prior)

    @property
    def _ranges(self) -> Mapping[str, tuple[float, float]]:
        return self.ranges or {}

    def priors_by_name(self) -> Mapping[str, Prior]:
        """Return the prior of the length scale, and of the amplitude where it has one."""
        if self.amplitude is None:
            return {"length_scale": self.length_scale}
        return {"length_scale": self.length_scale, "amplitude": self.amplitude}

    @property
    def coefficient_sd(self) -> float | None:  # type: ignore[override]
        """One, where the amplitude is inferred; else the default."""
        return None if self.amplitude is None else 1.0

    @property
    def coefficients(self) -> tuple[str, ...]:  # type: ignore[override]
        """One name a basis function."""
        d, n = len(self._ranges), self._n_waves
        return tuple(f"basis_{k}" for k in range(n**d if d <= 2 else n * d))

    def grid(self) -> dict[str, FloatArray]:
        """Return six length scales."""
        low, high = self.length_scale.support()
        if low > 0 and np.isfinite(high):
            nodes = np.geomspace(1.05 * low, high / 1.05, 6)
        else:
            nodes = np.asarray(self.length_scale.ppf((np.arange(6) + 0.5) / 6))
        if self.amplitude is None:
            return {"length_scale": nodes}
        return {"length_scale": nodes, "amplitude": self.amplitude.ppf([0.1, 0.3, 0.5, 0.7, 0.9])}

    def factors(self, X: Rows, theta: Rows) -> tuple[FloatArray, FloatArray]:
        """Return the basis functions, and the root of the spectral density of each."""
        n = self._n_waves
        waves = [hilbert.waves(_scaled(X[name], *ends), n) for name, ends in self._ranges.items()]
        heights = [hilbert.heights(theta["length_scale"], n)] * len(waves)
        of_rows, of_draws = (_joined(each) for each in (waves, heights))
        if self.amplitude is not None:
            # a sum over inputs has the variance of one process
            parts = len(waves) if len(waves) > 2 else 1
            of_draws = of_draws * np.reshape(theta["amplitude"], (-1, 1)) / np.sqrt(parts)
        return of_rows, of_draws

    @property
    def _n_waves(self) -> int:
        return _N_BASIS.get(len(self._ranges), _N_BASIS_EACH)

    def estimates(self, theta: Rows, coefficients: Rows) -> dict[str, FloatArray]:
        """Return the length scale on inputs scaled to [-1, 1], and the amplitude."""
        return {name: np.asarray(values) for name, values in theta.items()}

    def code(self) -> Code:
        """Return the cause as Python."""
        names = list(self._ranges)
        x = {f"x{k}": name for k, name in enumerate(names)}
        grids = {f"grid{k}": (*self._ends(name), _PLACES[1]) for k, name in enumerate(names)}
        if len(names) == 2:
            grids = {name: (low, high, _PLACES[2]) for name, (low, high, _) in grids.items()}
            held = {
                f"held{k}": f"np.clip({{x{k}}}, {{grid{k}}}[0], {{grid{k}}}[-1])" for k in (0, 1)
            }
            return Code(
                "{surface}({held0}, {held1}, grid=False)",
                columns=x,
                steps={"surface": "RectBivariateSpline({grid0}, {grid1}, {table0})", **held},
                grids=grids,
                tables=self._tables,
            )
        curves = [f"np.interp({{x{k}}}, {{grid{k}}}, {{table{k}}})" for k in range(len(names))]
        return Code(" + ".join(curves), columns=x, grids=grids, tables=self._tables)

    def _ends(self, name: str) -> tuple[float, float]:
        """Return the places of an input beyond which the curve is constant."""
        low, high = self._ranges[name]
        middle, reach = (low + high) / 2, hilbert.BOUNDARY * ((high - low) or 1.0) / 2
        return middle - reach, middle + reach

    def _tables(self, theta: Rows, coefficients: Rows) -> dict[str, FloatArray]:
        """Return the mean curve over each input, or the surface over two, on grids."""
        names = list(self._ranges)
        several = len(names) == 2
        grids = [np.linspace(*self._ends(name), _PLACES[2 if several else 1]) for name in names]
        if several:
            grids = [grid.ravel() for grid in np.meshgrid(*grids, indexing="ij")]
        # an effect of one input is that of its own waves: a sum of them needs no others
        X = dict(zip(names, grids, strict=True))
        of_rows, of_draws = self.factors(X, theta)
        mean = np.mean(of_draws * np.column_stack(list(coefficients.values())), axis=0)
        if several:
            return {"table0": (of_rows @ mean).reshape(_PLACES[2], _PLACES[2])}
        waves = self._n_waves
        parts = [slice(k * waves, (k + 1) * waves) for k in range(len(names))]
        return {f"table{k}": of_rows[:, part] @ mean[part] for k, part in enumerate(parts)}

    def formula(self, values: Mapping[str, float]) -> str:
        """Return the extended simulation in words."""
        return "simulation + a smooth discrepancy of unknown shape"


def _scaled(x: FloatArray, low: float, high: float) -> FloatArray:
    return (2 * x - low - high) / ((high - low) or 1.0)


def _joined(factors: Sequence[FloatArray]) -> FloatArray:
    """Return the factors of a tensor product of two inputs, or of a sum over inputs."""
    if len(factors) == 2:
        return np.einsum("rj,rk->rjk", *factors).reshape(len(factors[0]), -1)
    return np.hstack(factors)


register(
    Form(
        "unexplained",
        GaussianProcessDiscrepancy,
        lambda context: [GaussianProcessDiscrepancy()],
        like=("noise",),
        headline=(
            "The simulation misses a smooth change of {output} that no cause of "
            "the catalogue explains"
        ),
        formula="eta + a smooth curve over the inputs",
        priors="length scale on [-1, 1]: log-uniform, 0.15 (0.3 for several inputs) to 2",
        estimates="length_scale",
        left_out="never",
    )
)
