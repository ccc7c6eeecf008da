"""The curves that are hidden: written apart from those that any diagnosis fits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from hybridsurrogate.simulation.simulator import Simulator

from . import mechanisms
from .simulations import Array

# in the noise alone, where the simulation is steep: see `noises`
OF_SLOPE = ("input-error", "random-parameter")


@dataclass(frozen=True)
class Setting:
    """What is true apart from the effect, and where the measurements lie."""

    simulator: Simulator
    omega: Array  # (n_parameters + n_assumed,), constants as the modeller assumed them
    X: Array
    X_out: Array
    low: Array  # of the measured range, for each input
    span: Array
    output_range: float


Effect = tuple[Callable[[Array], Array], dict[str, Any]]


def run(setting: Setting, X: Array, omega: Array | None = None) -> Array:
    omega = np.tile(setting.omega, (len(X), 1)) if omega is None else omega
    return setting.simulator(X[:, : len(setting.low)], omega)


def _sign(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def between(rng: np.random.Generator, low: float, high: float) -> float:
    """Draw from a log-uniform distribution."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _added(
    kind: str, setting: Setting, rng: np.random.Generator
) -> tuple[Callable[[Array], Array], dict[str, Any]]:
    """Draw a curve that is added to the simulation."""
    j = int(rng.integers(len(setting.low)))
    low, span = setting.low[j], setting.span[j]
    height = _sign(rng) * between(rng, 0.03, 0.4) * setting.output_range
    truth: dict[str, Any] = {"target": setting.simulator.input_names[j]}
    if kind == "offset":
        return lambda X: np.full(len(X), height), {"target": "", "value": height}
    if kind == "missing-input":
        return lambda X: height * X[:, -1], {"target": "extra", "slope": height}
    if kind == "trend":
        # the simulation is right somewhere in the measured range: where it was tuned
        origin, slope = low + span * rng.uniform(), height / span
        truth |= {"slope": slope, "location": origin}
        return lambda X: slope * (X[:, j] - origin), truth
    if kind == "periodic":
        period, phase = span * between(rng, 0.15, 1.0), rng.uniform(0, 2 * np.pi)
        truth |= {"period": period, "phase": phase, "amplitude": abs(height)}
        return lambda X: abs(height) * np.sin(2 * np.pi * (X[:, j] - low) / period + phase), truth
    if kind == "step":
        location = low + span * rng.uniform(0.15, 0.85)
        truth |= {"location": location, "value": height}
        return lambda X: height * (X[:, j] > location), truth
    if kind == "bump":
        location, width = low + span * rng.uniform(0.1, 0.9), span * between(rng, 0.04, 0.15)
        truth |= {"location": location, "width": width, "amplitude": height}
        return lambda X: height * np.exp(-0.5 * ((X[:, j] - location) / width) ** 2), truth
    return _added_later(kind, setting, rng, j, height)


def _added_later(
    kind: str, setting: Setting, rng: np.random.Generator, j: int, height: float
) -> tuple[Callable[[Array], Array], dict[str, Any]]:
    """Draw a curve of the kinds that joined the test bed after the first nine."""
    low, span = setting.low[j], setting.span[j]
    first, last = setting.X[:, j].min(), setting.X[:, j].max()
    truth: dict[str, Any] = {"target": setting.simulator.input_names[j]}
    if kind == "trend: quadratic":
        # right where it was tuned, as for a straight trend; slope and curvature at the middle
        origin = low + span * rng.uniform()
        steep, bend = height / span, _sign(rng) * between(rng, 0.5, 3.0) * height / span**2
        at_middle = steep + 2 * bend * ((first + last) / 2 - origin)
        truth |= {"slope": at_middle, "curvature": bend, "location": origin}
        return lambda X: (X[:, j] - origin) * (steep + bend * (X[:, j] - origin)), truth
    if kind == "ramp":
        location = low + span * rng.uniform(0.15, 0.85)
        slope = height / (low + span - location)
        truth |= {"location": location, "slope": slope}
        return lambda X: np.where(X[:, j] > location, slope * (X[:, j] - location), 0.0), truth
    if kind == "decay":
        scale = span * between(rng, 0.05, 0.5)
        truth |= {"amplitude": height, "scale": scale}
        return lambda X: height * np.exp(-(np.clip(X[:, j], first, None) - first) / scale), truth
    if kind == "saturation":
        reach = span * between(rng, 0.05, 0.5)
        truth |= {"amplitude": height, "half": first + reach}

        def filled(X: Array) -> Array:
            beyond = np.clip(X[:, j] - first, 0, None)
            return height - height * reach / (reach + beyond)

        return filled, truth
    if kind == "trend: since the start":
        # right at the first measurement, and off by more and more since: a sensor set once
        slope = height / span
        truth |= {"slope": slope}
        return lambda X: slope * (X[:, j] - first), truth
    if kind == "episode":
        begin, end = _episode(low, span, rng)
        truth |= {"begin": begin, "end": end, "amplitude": height}
        return lambda X: np.where((begin < X[:, j]) & (X[:, j] <= end), height, 0.0), truth
    if kind == "missing-input: friction":
        # over the column that the simulation ignores, as the first or the last of its kind
        share = rng.uniform(0.3, 0.9)
        viscous, dry = (1 - share) * height, share * height
        truth = {"target": "extra", "viscous": viscous, "dry": dry}
        return lambda X: viscous * X[:, -1] + np.where(X[:, -1] < 0, -dry, dry), truth
    if kind == "interaction":
        measured = setting.X[:, :2]
        middle = (measured.min(axis=0) + measured.max(axis=0)) / 2
        slope = 4 * height / float(np.prod(setting.span[:2]))
        names = " * ".join(setting.simulator.input_names[:2])
        truth = {"target": names, "slope": slope}
        return lambda X: slope * np.prod(X[:, :2] - middle, axis=1), truth
    raise ValueError(f"Unknown kind {kind!r}.")


def _episode(low: float, span: float, rng: np.random.Generator) -> tuple[float, float]:
    """Draw where something begins, and where it ends, inside what is measured."""
    length = span * between(rng, 0.1, 0.5)
    begin = rng.uniform(low + 0.1 * span, low + 0.9 * span - length)
    return begin, begin + length


def _changed_output(kind: str, setting: Setting, rng: np.random.Generator) -> Effect | None:
    """Draw what becomes of the simulated output itself before it is measured."""
    j = int(rng.integers(len(setting.low)))
    low, span = setting.low[j], setting.span[j]
    output = run(setting, setting.X)
    numbers: dict[str, Any] = {"target": ""}
    if kind == "episode: factor":
        begin, end = _episode(low, span, rng)
        factor = 1 + _sign(rng) * between(rng, 0.05, 0.5)
        numbers = {"target": setting.simulator.input_names[j]}
        numbers |= {"begin": begin, "end": end, "factor": factor}

        def change(X: Array, y: Array) -> Array:
            return np.where((begin < X[:, j]) & (X[:, j] <= end), factor * y, y)

    elif kind == "build-up":
        # nothing is there at zero, as before a dose is taken up
        numbers = {"target": setting.simulator.input_names[j], "scale": between(rng, 0.05, 0.4)}
        numbers["scale"] *= span

        def change(X: Array, y: Array) -> Array:
            return y - y * np.exp(-X[:, j] / numbers["scale"])

    elif kind == "ramp: loss":
        numbers = {"target": setting.simulator.input_names[j]}
        location, scale = low + span * rng.uniform(0.15, 0.85), span * between(rng, 0.1, 3.0)
        numbers |= {"location": location, "scale": scale}

        def change(X: Array, y: Array) -> Array:
            return y * np.exp(-np.clip(X[:, j] - location, 0, None) / scale)

    elif kind == "limit":
        # an overflow, or a reading that ends there: so much of the measured rows is beyond
        share, above = rng.uniform(0.1, 0.4), rng.uniform() < 0.5
        limit = float(np.quantile(output, 1 - share if above else share))
        numbers |= {"limit": limit}

        def change(X: Array, y: Array) -> Array:
            return np.minimum(y, limit) if above else np.maximum(y, limit)

    else:
        # a sensor that is right at both ends of what it meets, and not between
        top, bottom = output.max(), output.min()
        bend = _sign(rng) * between(rng, 0.1, 0.8) / (top - bottom)
        numbers |= {"curvature": bend}

        def change(X: Array, y: Array) -> Array:
            return y + bend * (y - bottom) * (y - top)

    return lambda X: change(X, run(setting, X)), numbers


def _draw_delay(setting: Setting, rng: np.random.Generator) -> Effect | None:
    j = int(rng.integers(len(setting.low)))
    lag = _sign(rng) * between(rng, 0.01, 0.15) * setting.span[j]

    def truth(X: Array) -> Array:
        late = X.copy()
        late[:, j] -= lag
        return run(setting, late)

    with np.errstate(invalid="ignore", divide="ignore"):
        values = truth(np.concatenate([setting.X, setting.X_out]))
    # a logarithm of time has no values before its beginning
    if not np.isfinite(values).all():
        return None
    return truth, {"target": setting.simulator.input_names[j], "lag": lag}


def _draw_noise(setting: Setting, rng: np.random.Generator) -> Effect:
    """Draw along which input the noise grows or shrinks; how much is the size of the case."""
    j = int(rng.integers(len(setting.low)))
    numbers = {"target": setting.simulator.input_names[j], "column": j, "sign": _sign(rng)}
    return lambda X: run(setting, X), numbers


def _draw_other_drift(shape: str, setting: Setting, rng: np.random.Generator) -> Effect | None:
    """Draw a parameter that jumps, goes over into another value, swings, or grows by shares."""
    simulator = setting.simulator
    k, j = int(rng.integers(len(simulator.parameter_names))), int(rng.integers(len(setting.low)))
    name, along = simulator.parameter_names[k], simulator.input_names[j]
    low, high = simulator.parameter_ranges[name]
    start, span = setting.low[j], setting.span[j]
    change = _sign(rng) * rng.uniform(0.1, 0.6) * (high - low)
    numbers: dict[str, Any] = {"target": name, "along": along}
    if shape == "periodic":
        amplitude, period = abs(change) / 2, span * between(rng, 0.15, 1.0)
        phase = rng.uniform(0, 2 * np.pi)
        numbers |= {"period": period, "amplitude": amplitude}
        ends = setting.omega[k] + amplitude * np.array([-1.0, 1.0])

        def shift(x: Array) -> Array:
            return amplitude * np.sin(2 * np.pi * (x - start) / period + phase)

    elif shape in ("step", "logistic"):
        location, width = start + span * rng.uniform(0.15, 0.85), span * between(rng, 0.03, 0.2)
        numbers |= {"change": change, "location": location}
        numbers |= {"width": width} if shape == "logistic" else {}
        ends = setting.omega[k] + np.array([0.0, change])

        def shift(x: Array) -> Array:
            if shape == "step":
                return change * (x > location)
            return change / 2 * (1 + np.tanh((x - location) / (2 * width)))

    elif shape == "exponential":
        rate = _sign(rng) * between(rng, 0.2, 1.5) / span
        numbers |= {"rate": rate}
        # it goes on beyond the measurements, and must mean something there too
        reached = np.array(simulator.input_ranges[along], dtype=float)

        def shift(x: Array) -> Array:
            return setting.omega[k] * np.expm1(rate * (x - start - span / 2))

        ends = setting.omega[k] + shift(reached)
    else:
        raise ValueError(f"Unknown shape of drift {shape!r}.")
    if ends.min() < low or ends.max() > high:
        return None

    def truth(X: Array) -> Array:
        omega = np.tile(setting.omega, (len(X), 1))
        omega[:, k] += shift(X[:, j])
        return run(setting, X, omega)

    return truth, numbers


def draw_effect(kind: str, setting: Setting, rng: np.random.Generator) -> Effect | None:
    """Draw the noise-free truth as a function of X, and its numbers; None if out of bounds."""
    simulator, n_parameters = setting.simulator, len(setting.simulator.parameter_names)
    if kind in ("none", *OF_SLOPE) or kind.startswith("noise: "):
        # it is along the first input that noise is correlated
        along = simulator.input_names[0] if kind == "noise: autocorrelation" else ""
        return lambda X: run(setting, X), {"target": along}
    if kind == "gain":
        gain = 1 + _sign(rng) * between(rng, 0.03, 0.4)
        return lambda X: gain * run(setting, X), {"target": "", "gain": gain}
    if kind == "wrong-constant":
        k = int(rng.integers(len(simulator.assumed_names)))
        name = simulator.assumed_names[k]
        changed = setting.omega.copy()
        changed[n_parameters + k] = simulator.assumed[name].prior.ppf(rng.uniform(0.03, 0.97))
        truth = {"target": name, "value": changed[n_parameters + k]}
        return lambda X: run(setting, X, np.tile(changed, (len(X), 1))), truth
    if kind == "parameter-drift":
        return _draw_drift(setting, rng)
    if kind.startswith("parameter-drift: "):
        return _draw_other_drift(kind.removeprefix("parameter-drift: "), setting, rng)
    if kind == "delay":
        return _draw_delay(setting, rng)
    if kind == "noise":
        return _draw_noise(setting, rng)
    if kind in ("episode: factor", "build-up", "ramp: loss", "limit", "response"):
        return _changed_output(kind, setting, rng)
    if kind == "interaction" and len(setting.low) < 2:
        return None
    if kind in mechanisms.FORMS:
        return _foreign(kind.removeprefix("foreign: "), setting, rng)
    curve, truth = _added(kind, setting, rng)
    return lambda X: run(setting, X) + curve(X), truth


def _foreign(name: str, setting: Setting, rng: np.random.Generator) -> Effect:
    """Draw a mechanism that no cause of the catalogue draws."""
    height = _sign(rng) * between(rng, 0.03, 0.4) * setting.output_range
    if name == "square_of_missing":
        # in deviations, as the missing input itself
        middle = float(np.mean(setting.X[:, -1] ** 2))
        curve = lambda X: height * (X[:, -1] ** 2 - middle)  # noqa: E731
        return lambda X: run(setting, X) + curve(X), {"target": "extra"}
    # what is added lies along any input, what happens to the output along the first
    j = int(rng.integers(len(setting.low))) if name in mechanisms.CURVES else 0
    low, span = setting.low[j], setting.span[j]
    numbers = {"target": setting.simulator.input_names[j]}
    if name in mechanisms.CURVES:
        added = mechanisms.CURVES[name](rng)
        return lambda X: run(setting, X) + height * added((X[:, j] - low) / span), numbers
    change = mechanisms.CHANGES[name](rng)
    output = run(setting, setting.X)
    bottom, unit = output.min(), np.ptp(output)

    def truth(X: Array) -> Array:
        shares = (run(setting, X) - bottom) / unit
        return bottom + unit * change(shares, (X[:, j] - low) / span)

    return truth, numbers


def _draw_drift(setting: Setting, rng: np.random.Generator) -> Effect | None:
    simulator = setting.simulator
    k, j = int(rng.integers(len(simulator.parameter_names))), int(rng.integers(len(setting.low)))
    name = simulator.parameter_names[k]
    low, high = simulator.parameter_ranges[name]
    middle = setting.low[j] + setting.span[j] / 2
    slope = _sign(rng) * rng.uniform(0.1, 0.6) * (high - low) / setting.span[j]

    def values(x: Array) -> Array:
        return setting.omega[k] + slope * (x - middle)

    # it goes on drifting beyond the measurements, and must mean something there too
    ends = values(np.array(simulator.input_ranges[simulator.input_names[j]]))
    if ends.min() < low or ends.max() > high:
        return None

    def truth(X: Array) -> Array:
        omega = np.tile(setting.omega, (len(X), 1))
        omega[:, k] = values(X[:, j])
        return run(setting, X, omega)

    numbers = {
        "target": name,
        "along": simulator.input_names[j],
        "slope": slope,
        "location": middle,
    }
    return truth, numbers
