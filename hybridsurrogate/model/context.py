"""What causes may use of the simulation and the measured rows, gathered before they are fitted.

An output jumps where parameters hardly change if it is rounded, random, read from a table, or from
a solver with a loose tolerance. A difference over a short step is then a jump divided by next to
nothing, or zero between two jumps.

Two unknowns that change no row in common, such as deviations of two experiments, have their slopes
from one run: each row shows the slope of the unknown it depends on (Curtis, Powell and Reid 1974).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hybridsurrogate.effects.base import SIMULATED, SLOPE, Cause, Rows
from hybridsurrogate.effects.context import Context, OfOutput
from hybridsurrogate.likelihoods import Binomial, Likelihood
from hybridsurrogate.model.effects import CausesOnRows
from hybridsurrogate.model.observation import SHORTEST_STEP, MeasuredModel
from hybridsurrogate.model.rows.columns import Experiments
from hybridsurrogate.model.rows.stacking import Stacking
from hybridsurrogate.priors import check_prior
from hybridsurrogate.simulation.arrays import LARGEST
from hybridsurrogate.simulation.simulator import SimulationData, Simulator
from hybridsurrogate.surrogates.basis import Basis
from hybridsurrogate.types import FloatArray

# steps in standard deviations of the priors, and places at which slopes over two are compared
_STEPS = (SHORTEST_STEP, 10 * SHORTEST_STEP, 100 * SHORTEST_STEP)
LONGEST_STEP = _STEPS[-1]
_N_PLACES = 20
# slopes that differ by this share of their size, root mean square over rows and then averaged over
# places, disagree: smooth ones by some 1e-4, those of an output with a kink by 0.02, of one that
# jumps by 0.7 or more
_MAX_DISAGREEMENT = 0.2
# share of rows: jumps of fewer are not those of the output
_FEW_ROWS_SHARE = 0.1


def least_step(model: MeasuredModel, X: FloatArray) -> float:
    """Return the shortest step over which slopes agree with those over one ten times as long.

    In standard deviations of the priors, for a model without causes; zero for a smooth simulation,
    of which any step will do: slopes over a thousandth agree with those over a hundredth or, where
    it oscillates fast, over a ten-thousandth. A tenth where none agree.
    """
    if not model.basis.is_simulation or not model.n_parameters:
        return 0.0
    shortest, *slopes = [_slopes(model, X, step) for step in (_STEPS[0] / 10, *_STEPS)]
    # what hardly ever changes over so short a step may be about to jump
    changes = np.any(shortest != 0, axis=2).mean(axis=0) > 0.5
    is_smooth = changes & (_disagreement(shortest, slopes[0]) <= _MAX_DISAGREEMENT)
    # a parameter that is the place of a jump moves a row or two, however long the step
    is_smooth |= np.mean(slopes[-1] != 0, axis=(0, 2)) < _FEW_ROWS_SHARE
    for step, (shorter, longer) in zip(_STEPS, pairwise(slopes), strict=False):
        if np.all(is_smooth | (_disagreement(shorter, longer) <= _MAX_DISAGREEMENT)):
            return 0.0 if step == _STEPS[0] else step
    return LONGEST_STEP


def _disagreement(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return by which share of their size slopes (places, d, n) differ, (d,)."""
    size = np.maximum(np.linalg.norm(a, axis=2), np.linalg.norm(b, axis=2))
    there = size > 0
    # a place says no more than another one, however large its slopes, and nothing without any
    share = np.linalg.norm(a - b, axis=2) / np.where(there, size, 1.0)
    averaged: FloatArray = share.sum(axis=0) / np.maximum(there.sum(axis=0), 1)
    return averaged


def _slopes(model: MeasuredModel, X: FloatArray, step: float) -> FloatArray:
    """Return slopes (places, d, n) at places of the priors, zero where the simulation fails."""
    # a fixed spread, as the search is deterministic
    z = np.random.RandomState(0).standard_normal((_N_PLACES, model.n_parameters))
    ahead, behind = np.swapaxes(around(model, X, z, step), 0, 1)
    with np.errstate(invalid="ignore", over="ignore"):
        slopes: FloatArray = (ahead - behind) / (2 * step)
    slopes[~(np.abs(slopes) < LARGEST)] = 0.0
    return slopes


def around(model: MeasuredModel, X: FloatArray, z: FloatArray, step: float) -> FloatArray:
    """Return outputs (places, 2, d, n) a step ahead of and behind z (places, d)."""
    d = z.shape[1]
    points = z[:, None] + step * np.vstack([np.eye(d), -np.eye(d)])
    return output(model, X, points.reshape(-1, d)).reshape(len(z), 2, d, len(X))


def output(model: MeasuredModel, X: FloatArray, z: FloatArray) -> FloatArray:
    """Return the simulation's output (J, n) at z (J, d)."""
    return model.simulated(X, model.values(z), model.basis.coefficient_mean)[0]


class Moves(NamedTuple):
    """Directions (d,) shared by moves.

    Attributes
    ----------
    steps : ndarray of shape (m, n_unknowns)
        One where a move goes along an unknown, zero elsewhere.
    group : ndarray of shape (d,)
        The move of each direction.
    touched : ndarray of shape (d, n) or None
        Rows that a direction may change; None: each direction has a separate move.
    """

    steps: FloatArray
    group: NDArray[np.intp]
    touched: NDArray[np.bool_] | None

    def of_directions(self, slopes: FloatArray) -> FloatArray:
        """Return slopes (..., d, n) of directions, given those (..., m, n) of moves."""
        if self.touched is None:
            return slopes
        return np.where(self.touched, slopes[..., self.group, :], 0.0)


def disjoint_moves(model: CausesOnRows, X: FloatArray, directions: NDArray[np.intp]) -> Moves:
    """Return as few moves as directions that have rows in common need.

    Parameters
    ----------
    model : CausesOnRows
    X : ndarray of shape (n, n_columns)
    directions : ndarray of shape (d,)
        Positions among the unknowns.
    """
    rows = model.rows_moved(X)
    each = single_moves(model.n_unknowns, directions)
    if rows is None:
        return each
    touched = rows[directions]
    taken: list[NDArray[np.bool_]] = []
    group = np.empty(len(directions), dtype=np.intp)
    for k, own in enumerate(touched):
        free = (j for j, before in enumerate(taken) if not (before & own).any())
        group[k] = next(free, len(taken))
        if group[k] == len(taken):
            taken.append(own)
        else:
            taken[group[k]] = taken[group[k]] | own
    steps = np.zeros((len(taken), model.n_unknowns))
    np.add.at(steps, group, each.steps)
    return Moves(steps, group, touched)


def single_moves(n_unknowns: int, directions: NDArray[np.intp]) -> Moves:
    """Return one move for each direction (d,)."""
    return Moves(np.eye(n_unknowns)[directions], np.arange(len(directions)), None)


# standard normal coordinates of a cause's numbers at which its methods are tried
_PLACES_OF_CHECK = np.array([[0.0, 0.0], [-1.645, 1.645]])


def check_effects(model: MeasuredModel, X: FloatArray) -> None:
    """Raise ValueError, by name, for causes whose methods do not fit measured rows.

    For two draws at once, with the numbers of a cause at the middle of their priors and at the 5
    and 95 % quantiles: enough to see a wrong shape or NaN before it disappears in algebra.
    """
    for effect in model.effects:
        for name, prior in effect.parameters.items():
            check_prior(prior, f"{name} of the cause {effect.name}")
    n, d = 2 * len(X), model.n_parameters
    heights = np.linspace(-1.0, 1.0, n) * model.default_sd
    for places in _PLACES_OF_CHECK:
        z = np.zeros((2, model.n_unknowns))
        z[:, d : d + len(model.theta_names)] = places[:, None]
        rows, omega, theta = model.rows(X, model.values(z))
        of_noise = {**rows, SIMULATED: heights, SLOPE: heights}
        for effect, own in zip(model.effects, theta, strict=True):
            moved = _called(effect, "inputs", rows, omega, own)
            if not isinstance(moved, tuple) or len(moved) != 2:
                raise ValueError(
                    f"The cause {effect.name!r} must return two mappings from inputs: the columns "
                    "X and the parameters omega."
                )
            for name in (*model.columns[: model.n_inputs], *omega):
                value = moved[name in omega].get(name)
                _check_array(effect, f"inputs, {name!r}", value, [(n,)])
            _check_array(effect, "gain", _called(effect, "gain", rows, own), [(), (n,)])
            noise = _called(effect, "noise", of_noise, own)
            _check_array(effect, "noise", noise, [(), (n,)])
            if np.min(noise) <= 0:
                raise ValueError(
                    f"The cause {effect.name!r} returned a noise that is not positive."
                )
            if effect.coefficients:
                expected = [(n, len(effect.coefficients))]
                _check_array(effect, "columns", _called(effect, "columns", rows, own), expected)


def _called(effect: Cause, method: str, *arguments: Rows) -> Any:
    """Return what a method of a cause returns; an error raised there gets the cause's name."""
    try:
        return getattr(effect, method)(*arguments)
    except KeyError:
        # it uses a column that is not there, which is reported elsewhere
        raise
    except Exception as error:
        raise ValueError(
            f"The cause {effect.name!r} failed in {method}: {type(error).__name__}: {error}."
        ) from error


def _check_array(
    effect: Cause, method: str, value: object, shapes: Sequence[tuple[int, ...]]
) -> None:
    shape = None if value is None else np.shape(np.asarray(value))
    if shape not in shapes:
        hint = f" for its coefficients {effect.coefficients}" if method == "columns" else ""
        raise ValueError(
            f"The cause {effect.name!r} must return shape {' or '.join(map(str, shapes))} from "
            f"{method}{hint}, got {shape}."
        )
    if not np.isfinite(np.asarray(value, dtype=float)).all():
        raise ValueError(
            f"The cause {effect.name!r} returned NaN or infinity from {method}: its parameters "
            "were at the medians, or at the 5 or 95 % quantiles, of their priors."
        )


def make_context(
    simulation: SimulationData | Simulator | None,
    columns: tuple[str, ...],
    n_inputs: int,
    X: FloatArray,
    scale: float,
    likelihood: Likelihood,
    basis: Basis,
    location: float,
    far: tuple[float, float] = (0.0, 1.0),
    outputs: Mapping[str, OfOutput] | None = None,
    experiments: Experiments | None = None,
) -> Context:
    """Return what causes may use of the measured rows."""
    simulator = simulation.simulator if simulation is not None else None
    starts = simulator.starts if simulator else ()
    if not basis.is_simulation:
        simulator = None  # an emulator has no dynamics inside
    known = experiments or Experiments()
    return Context(
        dict(zip(columns, X.T, strict=False)),
        n_inputs,
        dict(simulation.parameters) if simulation else {},
        dict(simulation.assumed) if simulation else {},
        scale,
        log_scale=likelihood.log_scale,
        location=location,
        distance=far[0],
        ratio=far[1],
        states=simulator.typical_states(X[:, :n_inputs]) if simulator else {},
        remembers=simulator.remembers if simulator else False,
        resolved=simulator.resolved if simulator else 0.0,
        rates=simulator.rates if simulator else (),
        terms=simulator.terms if simulator else {},
        starts=starts,
        gaussian=likelihood.gaussian,
        scales_noise=likelihood.scales_noise,
        overdisperses=likelihood.overdispersed(np.zeros((1, 1))) is not None,
        trials=int(likelihood.trials) if isinstance(likelihood, Binomial) else None,
        outputs=tuple(outputs or ()),
        of_outputs=tuple((outputs or {}).values()),
        experiment=known.column,
        names=known.labels,
        by_experiment=tuple(known.by),
    )


def of_each_output(
    model: MeasuredModel,
    X: FloatArray,
    c: FloatArray,
    eta: FloatArray,
    weights: FloatArray,
    stacking: Stacking | None,
    likelihood: Likelihood,
) -> dict[str, OfOutput]:
    """Return what causes may use of each of several outputs; nothing of a single one."""
    out: dict[str, OfOutput] = {}
    for k, name in enumerate(() if stacking is None else stacking.names):
        assert stacking is not None
        here = X[:, stacking.at] == k
        distance, ratio = mismatch(model, X[here], c, eta[here], weights[here])
        location = float(np.average(eta[here], weights=weights[here]))
        scale = 1.0 if likelihood.log_scale else float(stacking.scale[k])
        out[name] = OfOutput(location, distance, ratio, scale)
    return out


def mismatch(
    model: MeasuredModel, X: FloatArray, c: FloatArray, eta: FloatArray, weights: FloatArray
) -> tuple[float, float]:
    """Return `Context.distance` and `Context.ratio` of outputs eta (n,) at the priors' medians.

    Coefficients c (p,) are those of the surrogate. Where the simulation fails there, or one of the
    two is zero everywhere, nothing is known.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        simulated = model.simulated(X, at_medians(model), c)[0][0]
        gap = float(np.average(eta - simulated, weights=weights))
        squares = [float(np.average(np.square(v), weights=weights)) for v in (eta, simulated)]
    if not np.isfinite([gap, *squares]).all() or not min(squares) > 0:
        return 0.0, 1.0
    return gap, float(np.sqrt(squares[0] / squares[1]))


def at_medians(model: MeasuredModel) -> FloatArray:
    """Return all unknowns at the medians of their priors, (1, n_unknowns)."""
    return model.values(np.zeros((1, len(model.all_priors))))


def with_slopes(
    context: Context, model: MeasuredModel, X: FloatArray, c: FloatArray, values: FloatArray
) -> Context:
    """Return the context with `Context.slopes` at one draw (1, n_unknowns) of the unknowns.

    Zero where a run fails. Coefficients c (p,) are those of the surrogate.
    """
    # numbers of known effects inside the dynamics are no quantities of the simulation
    numbers = [name for name in model.constants if name in context.assumed]
    names = (*context.inputs, *model.parameters, *numbers)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        output = model.simulated(X, values, c)[0]
        slopes = {
            name: model.slope(name, context.usual_change(name), X, values, c, output)[0]
            for name in names
        }
    known = {name: np.nan_to_num(v, posinf=0.0, neginf=0.0) for name, v in slopes.items()}
    return replace(context, slopes=known)
