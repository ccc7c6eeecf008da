"""What causes may use of the simulation and the measured rows, gathered before they are fitted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from hybridsurrogate.effects.context import Context, OfOutput
from hybridsurrogate.likelihoods import Binomial, Likelihood
from hybridsurrogate.model.observation import MeasuredModel
from hybridsurrogate.model.rows.experiments import Experiments
from hybridsurrogate.model.rows.stacking import Stacking
from hybridsurrogate.simulation.simulator import SimulationData, Simulator
from hybridsurrogate.surrogates.basis import Basis
from hybridsurrogate.types import FloatArray


class Mismatch(NamedTuple):
    """How far measured outputs lie from simulated ones: `Context.distance` and `Context.ratio`."""

    distance: float = 0.0
    ratio: float = 1.0


def make_context(
    simulation: SimulationData | Simulator | None,
    columns: tuple[str, ...],
    n_inputs: int,
    X: FloatArray,
    scale: float,
    likelihood: Likelihood,
    basis: Basis,
    location: float,
    far: Mismatch | None = None,
    outputs: Mapping[str, OfOutput] | None = None,
    experiments: Experiments | None = None,
) -> Context:
    """Return what causes may use of the measured rows."""
    far = far or Mismatch()
    simulator = simulation.simulator if simulation is not None else None
    starts = simulator.starts if simulator else ()
    if not basis.is_simulation:
        simulator = None  # an emulator has no dynamics inside
    return Context(
        dict(zip(columns, X.T, strict=False)),
        n_inputs,
        dict(simulation.parameters) if simulation else {},
        dict(simulation.assumed) if simulation else {},
        scale,
        log_scale=likelihood.log_scale,
        location=location,
        distance=far.distance,
        ratio=far.ratio,
        states=simulator.typical_states(X[:, :n_inputs]) if simulator else {},
        remembers=simulator.remembers if simulator else False,
        rates=simulator.rates if simulator else (),
        starts=starts,
        gaussian=likelihood.gaussian,
        scales_noise=likelihood.scales_noise,
        overdisperses=likelihood.overdispersed(np.zeros((1, 1))) is not None,
        trials=int(likelihood.trials) if isinstance(likelihood, Binomial) else None,
        outputs=tuple(outputs or ()),
        of_outputs=tuple((outputs or {}).values()),
        experiment=experiments.column if experiments else None,
        experiment_labels=experiments.labels if experiments else None,
        by_experiment=tuple(experiments.by) if experiments else (),
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
        far = mismatch(model, X[here], c, eta[here], weights[here])
        location = float(np.average(eta[here], weights=weights[here]))
        scale = 1.0 if likelihood.log_scale else float(stacking.scale[k])
        out[name] = OfOutput(location, far.distance, far.ratio, scale)
    return out


def mismatch(
    model: MeasuredModel, X: FloatArray, c: FloatArray, eta: FloatArray, weights: FloatArray
) -> Mismatch:
    """Compare outputs eta (n,) with the simulation's at the medians of all priors.

    Coefficients c (p,) are those of the surrogate. Where the simulation fails there, or one of the
    two is zero everywhere, nothing is known.
    """
    medians = at_medians(model)
    with np.errstate(over="ignore", invalid="ignore"):
        simulated = model.simulated(X, medians, c)[0][0]
        gap = float(np.average(eta - simulated, weights=weights))
        squares = [float(np.average(np.square(v), weights=weights)) for v in (eta, simulated)]
    if not np.isfinite([gap, *squares]).all() or not min(squares) > 0:
        return Mismatch()
    return Mismatch(gap, float(np.sqrt(squares[0] / squares[1])))


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
