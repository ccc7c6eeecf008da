"""Whether the methods of causes fit measured rows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hybridsurrogate.effects.base import SIMULATED, Cause
from hybridsurrogate.inference.measured import MeasuredModel
from hybridsurrogate.priors import FloatArray, check_prior


def check_effects(model: MeasuredModel, X: FloatArray) -> None:
    """Raise ValueError, by name, for causes whose methods do not fit measured rows.

    At the middle of every prior, for two draws at once: enough to see a wrong shape or NaN
    before it disappears in algebra.
    """
    for effect in model.effects:
        for name, prior in effect.parameters.items():
            check_prior(prior, f"{name} of the cause {effect.name}")
    rows, omega, theta = model.rows(X, model.values(np.zeros((2, model.n_unknowns))))
    of_noise = {**rows, SIMULATED: np.linspace(-1.0, 1.0, 2 * len(X)) * model.default_sd}
    n = 2 * len(X)
    for effect, own in zip(model.effects, theta, strict=True):
        run_rows, run_omega = effect.inputs(rows, omega, own)
        for name in (*model.columns[: model.n_inputs], *omega):
            moved = run_omega if name in omega else run_rows
            _check_array(effect, f"inputs, {name!r}", moved.get(name), [(n,)])
        _check_array(effect, "gain", effect.gain(rows, own), [(), (n,)])
        noise = effect.noise(of_noise, own)
        _check_array(effect, "noise", noise, [(), (n,)])
        if np.min(noise) <= 0:
            raise ValueError(f"The cause {effect.name!r} returned a noise that is not positive.")
        if effect.coefficients:
            expected = [(n, len(effect.coefficients))]
            _check_array(effect, "columns", effect.columns(rows, own), expected)


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
            "were at the medians of their priors."
        )
