"""What a careful engineer does by hand about a simulation that misses something.

Every explanation in the list is fitted by least squares from many starts, parameters bounded by the
support of their priors, and the smallest BIC wins; an explanation pays 2 ln(number of explanations
tried) for the search. It knows nothing of the package's own diagnosis: it is what that is measured
against. ``python -m tests.hidden_effects.by_hand`` prints how often it is right.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from hybridsurrogate.simulation import Simulator

Array = NDArray[np.float64]

KINDS = (
    "offset",
    "trend",
    "periodic",
    "step",
    "bump",
    "gain",
    "wrong-constant",
    "parameter-drift",
    "missing-input",
)

# what is searched, in shares of the measured span: a little more than a test case can hold
_PERIODS = (0.12, 1.25)
_WIDTHS = (0.03, 0.2)

_N_CENTRES = 24
_N_STARTS = 16
_N_STEPS = 30


@dataclass(frozen=True)
class Form:
    """One explanation with its target, as curves that can be fitted.

    ``columns(X, shape)`` gives (S, n, q) curves with free coefficients for S sets of shape numbers,
    ``rewrite(X, omega, shape)`` changes parameters and constants, (S, n, k), row by row.
    """

    kind: str
    target: str
    n_numbers: int
    bounds: Array  # (m, 2), of the shape numbers, which do not enter linearly
    starts: Array  # (s, m)
    columns: Callable[[Array, Array], Array] | None = None
    rewrite: Callable[[Array, Array, Array], Array] | None = None
    shape_is_free: bool = True  # False: only the values in `starts` are tried, a step's locations


@dataclass(frozen=True)
class Fit:
    """A fitted form: ``numbers`` are the parameters, then the shape numbers."""

    form: Form
    numbers: Array
    coefficients: Array
    rss: float


@dataclass(frozen=True)
class _Problem:
    simulator: Simulator
    X: Array
    y: Array
    low: Array  # of the parameters
    high: Array
    spread: Array  # (s, p) parameter values all over the priors' support


# ---------------------------------------------------------------------------- the explanations


def _plain() -> Form:
    return Form("none", "", 0, np.empty((0, 2)), np.empty((1, 0)))


def forms(simulator: Simulator, X: Array) -> list[Form]:
    """List every explanation for these measurements, once for each possible target."""
    n_inputs = len(simulator.input_names)
    found = [_linear("offset", "", 1, lambda X: np.ones((len(X), 1)))]
    for j, name in enumerate(simulator.input_names):
        found += _forms_along(j, name, X[:, j])
    # the simulation's own curve is the column, so `_columns` supplies it
    found.append(Form("gain", "", 1, np.empty((0, 2)), np.empty((1, 0))))
    ranges = list(simulator.parameter_ranges.values())
    for k, name in enumerate(simulator.parameter_names):
        found += [
            _drift(k, name, ranges[k], j, X[:, j]) for j, _ in enumerate(simulator.input_names)
        ]
    for k, name in enumerate(simulator.assumed_names, start=len(simulator.parameter_names)):
        found.append(_wrong_constant(k, name, ranges[k]))
    for j in range(n_inputs, X.shape[1]):
        found.append(_missing(j, X[:, j].mean()))
    return found


def _linear(kind: str, target: str, n_numbers: int, curves: Callable[[Array], Array]) -> Form:
    def columns(X: Array, shape: Array) -> Array:
        return np.broadcast_to(curves(X), (len(shape), *curves(X).shape))

    return Form(kind, target, n_numbers, np.empty((0, 2)), np.empty((1, 0)), columns)


def _missing(j: int, mean: float) -> Form:
    return _linear("missing-input", "extra", 1, lambda X: X[:, [j]] - mean)


def _forms_along(j: int, name: str, x: Array) -> list[Form]:
    low, span = x.min(), np.ptp(x)

    def line(X: Array) -> Array:
        # where the simulation was right is not known, so a line needs two numbers
        return np.column_stack([np.ones(len(X)), (X[:, j] - low) / span])

    def waves(X: Array, shape: Array) -> Array:
        angle = 2 * np.pi * (X[:, j] - low) * shape  # by frequency: the grid is even in it
        return np.stack([np.sin(angle), np.cos(angle)], axis=-1)

    def steps(X: Array, shape: Array) -> Array:
        return (X[:, j] > shape)[..., None].astype(float)

    def bumps(X: Array, shape: Array) -> Array:
        location, width = shape[:, :1], np.exp(shape[:, 1:])
        return np.exp(-0.5 * ((X[:, j] - location) / width) ** 2)[..., None]

    frequency = (1 / (_PERIODS[1] * span), 1 / (_PERIODS[0] * span))
    values = np.unique(x)
    # two points on either side, or it is an outlier rather than a step
    between = (values[1:-2] + values[2:-1]) / 2
    log_width = np.log(np.multiply(_WIDTHS, span))
    bump_starts = [
        (location, width)
        for location in np.linspace(low, low + span, 25)
        for width in np.linspace(*log_width, 5)
    ]
    return [
        _linear("trend", name, 2, line),
        Form(
            "periodic",
            name,
            3,
            np.array([frequency]),
            np.linspace(*frequency, 40)[:, None],
            waves,
        ),
        Form(
            "step",
            name,
            2,
            np.array([[low, low + span]]),
            between[:, None],
            steps,
            shape_is_free=False,
        ),
        Form(
            "bump",
            name,
            3,
            np.array([[low, low + span], log_width]),
            np.array(bump_starts),
            bumps,
        ),
    ]


def _drift(k: int, name: str, limits: tuple[float, float], j: int, x: Array) -> Form:
    middle, half = (x.min() + x.max()) / 2, np.ptp(x) / 2
    reach = (limits[1] - limits[0]) / 2

    def rewrite(X: Array, omega: Array, shape: Array) -> Array:
        drifted = omega.copy()
        drifted[..., k] += shape * (X[:, j] - middle) / half
        drifted[..., k] = np.clip(drifted[..., k], *limits)
        return drifted

    starts = reach * np.linspace(-0.8, 0.8, 9)[:, None]
    return Form("parameter-drift", name, 1, np.array([[-reach, reach]]), starts, rewrite=rewrite)


def _wrong_constant(k: int, name: str, limits: tuple[float, float]) -> Form:
    def rewrite(X: Array, omega: Array, shape: Array) -> Array:
        changed = omega.copy()
        changed[..., k] = shape
        return changed

    starts = np.linspace(*limits, 11)[1:-1, None]
    return Form("wrong-constant", name, 1, np.array([limits]), starts, rewrite=rewrite)


# ------------------------------------------------------------------------------ their curves


def _curves(simulator: Simulator, form: Form, X: Array, numbers: Array) -> Array:
    """Run the simulation for S sets of numbers, all in one call: (S, n)."""
    p = len(simulator.parameter_names)
    constants = [simulator.assumed[name].value for name in simulator.assumed_names]
    omega = np.empty((len(numbers), len(X), p + len(constants)))
    omega[..., :p] = numbers[:, None, :p]
    omega[..., p:] = constants
    if form.rewrite is not None:
        omega = form.rewrite(X, omega, numbers[:, p:])
    inputs = np.tile(X[:, : len(simulator.input_names)], (len(numbers), 1))
    values = simulator(inputs, omega.reshape(-1, omega.shape[-1]))
    return values.reshape(len(numbers), len(X))


def _columns(form: Form, X: Array, shape: Array, curves: Array) -> Array | None:
    if form.kind == "gain":
        return curves[..., None]
    return None if form.columns is None else form.columns(X, shape)


def _residuals(problem: _Problem, form: Form, numbers: Array) -> Array:
    """Return what is left of y, (S, n), the coefficients being at their best for each set."""
    curves = _curves(problem.simulator, form, problem.X, numbers)
    columns = _columns(form, problem.X, numbers[:, len(problem.low) :], curves)
    rest = problem.y - curves
    if columns is None:
        return rest
    q = np.linalg.qr(columns)[0]
    return rest - np.einsum("snq,sq->sn", q, np.einsum("snq,sn->sq", q, rest))


def predict(simulator: Simulator, fit: Fit, X: Array) -> Array:
    """Predict with a fitted explanation at any inputs, beyond the measured ones too."""
    numbers = fit.numbers[None]
    curves = _curves(simulator, fit.form, X, numbers)
    columns = _columns(fit.form, X, numbers[:, len(simulator.parameter_names) :], curves)
    return curves[0] if columns is None else curves[0] + columns[0] @ fit.coefficients


# ------------------------------------------------------------------------------- fitting them


def _problem(simulator: Simulator, X: Array, y: Array, rng: np.random.Generator) -> _Problem:
    ranges = [simulator.parameter_ranges[name] for name in simulator.parameter_names]
    low, high = np.array(ranges).T
    spread = low + (high - low) * qmc.Sobol(len(low), rng=rng).random(64)
    return _Problem(simulator, X, y, low, high, spread)


def fit_kind(
    simulator: Simulator, X: Array, y: Array, kind: str, rng: np.random.Generator
) -> list[Fit]:
    """Fit one kind ("none" too), once for each possible target, the best first."""
    problem = _problem(simulator, X, y, rng)
    plain = _fit_plain(problem)
    if kind == "none":
        return [plain]
    fits = [_fit(problem, form, plain) for form in forms(simulator, X) if form.kind == kind]
    return sorted(fits, key=lambda fit: fit.rss)


def _fit_plain(problem: _Problem) -> Fit:
    form = _plain()
    rss = (_residuals(problem, form, problem.spread) ** 2).sum(axis=1)
    return _descend(problem, form, problem.spread[np.argsort(rss)[:_N_STARTS]])


def _fit(problem: _Problem, form: Form, plain: Fit) -> Fit:
    linear = form.rewrite is None
    starts = (_linearised_starts if linear else _spread_starts)(problem, form, plain)
    return _descend(problem, form, starts)


def _spread_starts(problem: _Problem, form: Form, plain: Fit) -> Array:
    """Starts for a form that changes the simulation's own inputs: tried all over the box."""
    p = len(problem.low)
    around = np.column_stack([np.tile(plain.numbers, (len(form.starts), 1)), form.starts])
    n_each = 3
    anywhere = np.column_stack(
        [
            np.repeat(problem.spread, n_each, axis=0),
            form.starts[np.arange(n_each * len(problem.spread)) * 4 % len(form.starts)],
        ]
    )
    found = []
    for points, n_best in ((around, 4), (anywhere, _N_STARTS - 4)):
        rss = (_residuals(problem, form, points) ** 2).sum(axis=1)
        found.append(points[np.argsort(rss)[:n_best]])
    return np.concatenate(found).reshape(-1, p + len(form.bounds))


def _linearised_starts(problem: _Problem, form: Form, plain: Fit) -> Array:
    """Starts for a form with columns: every shape, the parameters free to first order.

    A wrong shape often looks right until the parameters may move with it, so they move already
    here: around the plain fit and around parameter values all over the priors.
    """
    centres = np.concatenate([plain.numbers[None], problem.spread[:_N_CENTRES]])
    curves = _curves(problem.simulator, _plain(), problem.X, centres)
    slopes = _slopes(problem, _plain(), centres, curves)
    found = []
    for i, (centre, curve, jacobian) in enumerate(zip(centres, curves, slopes, strict=True)):
        rest = problem.y - curve
        columns = _columns(form, problem.X, form.starts, curve[None])
        basis = np.linalg.qr(jacobian)[0]
        outside = columns - basis @ (basis.T @ columns)
        gram = outside.transpose(0, 2, 1) @ outside
        # a curve that the parameters follow entirely leaves nothing to divide by
        scale = np.einsum("snq,snq->s", columns, columns)
        gram += 1e-9 * scale[:, None, None] * np.eye(gram.shape[-1])
        against = outside.transpose(0, 2, 1) @ (rest - basis @ (basis.T @ rest))
        coefficients = np.linalg.solve(gram, against[..., None])[..., 0]
        explained = np.einsum("sq,sq->s", coefficients, against)
        n_best = _N_STARTS if i == 0 else 2
        for s in np.argsort(-explained)[:n_best]:
            left = rest - columns[s] @ coefficients[s]
            move = np.linalg.lstsq(jacobian, left, rcond=1e-8)[0]
            omega = np.clip(centre + move, problem.low, problem.high)
            found.append(np.concatenate([omega, form.starts[s]]))
    points = np.array(found)
    rss = (_residuals(problem, form, points) ** 2).sum(axis=1)
    order = np.argsort(rss)
    # not all starts with one shape: the best of each shape first
    shapes = points[order, len(problem.low) :].round(12)
    first = np.unique(shapes, axis=0, return_index=True)[1]
    others = np.setdiff1d(np.arange(len(order)), first)
    return points[order[np.concatenate([np.sort(first), others])[:_N_STARTS]]]


def _slopes(problem: _Problem, form: Form, numbers: Array, at: Array | None = None) -> Array:
    """Differentiate curves, if ``at`` holds them, or else residuals: (S, n, number)."""
    low, high = _box(problem, form)
    step = 1e-6 * (high - low)
    step = np.where(numbers + step > high, -step, step)
    moved = numbers[:, None, :] + step[:, :, None] * np.eye(len(low))
    flat = moved.reshape(-1, len(low))
    if at is None:
        after, before = _residuals(problem, form, flat), _residuals(problem, form, numbers)
    else:
        after, before = _curves(problem.simulator, form, problem.X, flat), at
    change = after.reshape(len(numbers), len(low), -1) - before[:, None, :]
    return (change / step[..., None]).transpose(0, 2, 1)


def _box(problem: _Problem, form: Form) -> tuple[Array, Array]:
    return (
        np.concatenate([problem.low, form.bounds[:, 0]]),
        np.concatenate([problem.high, form.bounds[:, 1]]),
    )


def _descend(problem: _Problem, form: Form, starts: Array) -> Fit:
    """Levenberg and Marquardt's descent inside the box, from all starts at once."""
    low, high = _box(problem, form)
    width = high - low
    moves = np.ones(len(low), dtype=bool)
    moves[len(problem.low) :] = form.shape_is_free
    numbers = np.clip(starts, low, high)
    left = _residuals(problem, form, numbers)
    rss = (left**2).sum(axis=1)
    damping, idle = np.full(len(numbers), 1e-3), 0
    for _ in range(_N_STEPS):
        jacobian = _slopes(problem, form, numbers) * width
        gradient = np.einsum("snv,sn->sv", jacobian, left)
        hessian = jacobian.transpose(0, 2, 1) @ jacobian
        # a number at a bound that would leave the box stays where it is
        stuck = (numbers <= low) & (gradient > 0) | (numbers >= high) & (gradient < 0) | ~moves
        gradient = np.where(stuck, 0.0, gradient)
        hessian[stuck[:, :, None] | stuck[:, None, :]] = 0.0
        diagonal = np.einsum("svv->sv", hessian)
        diagonal += damping[:, None] * diagonal + 1e-12 * rss[:, None] + 1e-300
        diagonal[stuck] = 1.0
        move = -np.linalg.solve(hessian, gradient[..., None])[..., 0]
        trial = np.clip(numbers + width * move, low, high)
        trial_left = _residuals(problem, form, trial)
        trial_rss = (trial_left**2).sum(axis=1)
        better = trial_rss < rss
        gain = np.where(better, 1 - trial_rss / np.maximum(rss, 1e-300), 0.0)
        numbers[better], left[better], rss[better] = (
            trial[better],
            trial_left[better],
            trial_rss[better],
        )
        damping = np.clip(np.where(better, damping / 5, damping * 8), 1e-9, 1e9)
        idle = 0 if (gain > 1e-8).any() else idle + 1
        if idle == 4:  # shorter steps, by damping, have been tried from all starts
            break
    best = int(np.argmin(rss))
    numbers = numbers[best]
    return Fit(form, numbers, _coefficients(problem, form, numbers), float(rss[best]))


def _coefficients(problem: _Problem, form: Form, numbers: Array) -> Array:
    curves = _curves(problem.simulator, form, problem.X, numbers[None])
    columns = _columns(form, problem.X, numbers[None, len(problem.low) :], curves)
    if columns is None:
        return np.empty(0)
    return np.linalg.lstsq(columns[0], problem.y - curves[0], rcond=None)[0]


# ------------------------------------------------------------------------------- choosing one


def bic(fit: Fit, n: int) -> float:
    """BIC of a least-squares fit; the noise counts as a fitted number."""
    p = len(fit.numbers) - len(fit.form.bounds)
    return n * np.log(max(fit.rss, 1e-300) / n) + (p + fit.form.n_numbers + 1) * np.log(n)


def diagnose_by_hand(
    simulator: Simulator, X: Array, y: Array, rng: np.random.Generator
) -> dict[str, Any]:
    """Fit every explanation and choose by BIC.

    Parameters
    ----------
    simulator : Simulator
    X : array of shape (n, n_inputs + number of recorded columns that the simulation ignores)
    y : array of shape (n,)
    rng : Generator
        Places the starts.

    Returns
    -------
    dict
        ``kind``, ``target``, ``bic`` (kind and target to BIC with the price of the search),
        ``predict`` and ``predict_none``, functions of X: with what was chosen, and with the
        simulation as it is, calibrated.
    """
    problem = _problem(simulator, X, y, rng)
    plain = _fit_plain(problem)
    fits = [_fit(problem, form, plain) for form in forms(simulator, X)]
    search = 2 * np.log(len(fits))
    table = {(plain.form.kind, plain.form.target): (bic(plain, len(y)), plain)}
    for fit in fits:
        # a drift of one parameter along either of two inputs has one name: the better one stays
        key, value = (fit.form.kind, fit.form.target), bic(fit, len(y)) + search
        if key not in table or value < table[key][0]:
            table[key] = (value, fit)
    (kind, target), (_, best) = min(table.items(), key=lambda item: item[1][0])
    return {
        "kind": kind,
        "target": target,
        "bic": {key: value for key, (value, _) in table.items()},
        "predict": lambda X: predict(simulator, best, X),
        "predict_none": lambda X: predict(simulator, plain, X),
    }


# ---------------------------------------------------------------------------- how good that is


def _rmse(a: Array, b: Array) -> float:
    return float(np.sqrt(np.mean((a - b) ** 2)))


def judge(case: Any, found: dict[str, Any], seconds: float) -> dict[str, Any]:
    """Compare one diagnosis with the truth of its case."""
    from .cases import same_curve

    kind = case.truth["kind"]
    return {
        "simulation": case.simulator.name,
        "truth": kind,
        "found": found["kind"],
        "exact": found["kind"] == kind,
        "equivalent": same_curve(case, kind, found["kind"]),
        "ratio": _rmse(found["predict"](case.X_out), case.mu_out)
        / _rmse(found["predict_none"](case.X_out), case.mu_out),
        "seconds": seconds,
    }


def by_hand_rates(
    sizes: Sequence[float] = (1, 2, 4), n_seeds: int = 15, n_null: int = 200, first_seed: int = 0
) -> dict[Any, list[dict[str, Any]]]:
    """Diagnose ``n_seeds`` cases of every kind and size, and ``n_null`` in which nothing is wrong.

    Returns
    -------
    dict
        Size, or "none", to a list with one row of results for each case.
    """
    from .cases import make_case

    rows: dict[Any, list[dict[str, Any]]] = {}
    jobs = [
        (size, kind, first_seed + s) for size in sizes for kind in KINDS for s in range(n_seeds)
    ]
    jobs += [("none", "none", first_seed + s) for s in range(n_null)]
    for size, kind, seed in jobs:
        case = make_case(kind, 0.0 if kind == "none" else size, seed)
        start = time.perf_counter()
        found = diagnose_by_hand(case.simulator, case.X, case.y, np.random.default_rng(seed))
        rows.setdefault(size, []).append(judge(case, found, time.perf_counter() - start))
    return rows


def print_rates(rows: dict[Any, list[dict[str, Any]]]) -> None:
    """Print the table of rates, then the rate by kind, then who was mistaken for whom."""
    print("size   cases  right first  with the same curve  out-of-range RMSE  seconds")
    for size, found in rows.items():
        share = [100 * np.mean([row[word] for row in found]) for word in ("exact", "equivalent")]
        ratio, seconds = (np.median([row[word] for row in found]) for word in ("ratio", "seconds"))
        print(
            f"{size!s:5} {len(found):6} {share[0]:11.1f}% {share[1]:19.1f}% {ratio:18.3f} "
            f"{seconds:8.2f}"
        )
    if "none" in rows:
        wrong = np.mean([not row["exact"] for row in rows["none"]])
        print(f"false alarms on none: {100 * wrong:.1f}% of {len(rows['none'])}")
    for kind in KINDS:
        parts = []
        for size, found in rows.items():
            mine = [row for row in found if row["truth"] == kind]
            if mine:
                parts.append(f"{size}: {100 * np.mean([row['equivalent'] for row in mine]):5.1f}%")
        print(f"{kind:16} " + "  ".join(parts))
    confused: dict[tuple[Any, str, str], int] = {}
    for size, found in rows.items():
        for row in found:
            if not row["equivalent"]:
                key = (size, row["truth"], row["found"])
                confused[key] = confused.get(key, 0) + 1
    most = sorted(confused.items(), key=lambda item: -item[1])[:20]
    for (size, truth, kind), count in most:
        print(f"  size {size}: {truth} taken for {kind}, {count} times")


def main() -> None:
    """Print the rates."""
    parser = argparse.ArgumentParser(description="Rates of what an engineer does by hand.")
    parser.add_argument("--sizes", type=float, nargs="+", default=[1, 2, 4])
    parser.add_argument("--seeds", type=int, default=15)
    parser.add_argument("--nulls", type=int, default=200)
    parser.add_argument("--first-seed", type=int, default=0)
    given = parser.parse_args()
    print_rates(by_hand_rates(given.sizes, given.seeds, given.nulls, given.first_seed))


if __name__ == "__main__":
    main()
