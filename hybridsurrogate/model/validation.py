"""Whether the methods of causes fit measured rows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from hybridsurrogate.effects.base import SIMULATED, SLOPE, Cause, Rows
from hybridsurrogate.model.observation import MeasuredModel
from hybridsurrogate.priors import check_prior
from hybridsurrogate.types import FloatArray

# standard normal coordinates of a cause's numbers at which its methods are tried
_PLACES = np.array([[0.0, 0.0], [-1.645, 1.645]])


def check_effects(model: MeasuredModel, X: FloatArray) -> None:
    """Raise ValueError, by name, for causes whose methods do not fit measured rows.

    For two draws at once, with the numbers of a cause at the middle of their priors and at the 5
    and 95 % quantiles: enough to see a wrong shape or NaN before it disappears in algebra.
    """
    for effect in model.effects:
        for name, prior in effect.parameters.items():
            check_prior(prior, f"{name} of the cause {effect.name}")
    for places in _PLACES:
        _check_at(model, X, places)


def _check_at(model: MeasuredModel, X: FloatArray, places: FloatArray) -> None:
    z = np.zeros((len(places), model.n_unknowns))
    z[:, model.n_parameters : model.n_parameters + len(model.theta_names)] = places[:, None]
    rows, omega, theta = model.rows(X, model.values(z))
    n = len(z) * len(X)
    heights = np.linspace(-1.0, 1.0, n) * model.default_sd
    of_noise = {**rows, SIMULATED: heights, SLOPE: heights}
    for effect, own in zip(model.effects, theta, strict=True):
        moved = _called(effect, "inputs", rows, omega, own)
        if not isinstance(moved, tuple) or len(moved) != 2:
            raise ValueError(
                f"The cause {effect.name!r} must return two mappings from inputs: the columns X "
                "and the parameters omega."
            )
        for name in (*model.columns[: model.n_inputs], *omega):
            value = moved[name in omega].get(name)
            _check_array(effect, f"inputs, {name!r}", value, [(n,)])
        _check_array(effect, "gain", _called(effect, "gain", rows, own), [(), (n,)])
        noise = _called(effect, "noise", of_noise, own)
        _check_array(effect, "noise", noise, [(), (n,)])
        if np.min(noise) <= 0:
            raise ValueError(f"The cause {effect.name!r} returned a noise that is not positive.")
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
