"""Mechanisms that no cause of the catalogue draws: what does a diagnosis say where none is right?

Each is a curve that is added along one input, or what becomes of the simulated output. Some come
near a kind of the catalogue, as they do in the world, and none is one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from .simulations import Array

Random = np.random.Generator
# of u, which is 0 where the measured range of an input begins and 1 where it ends
Curve = Callable[[Array], Array]
# of the simulated output v, about 0 to 1 over the measured rows, and of u
Change = Callable[[Array, Array], Array]


def _between(rng: Random, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _wave(rng: Random) -> tuple[float, float]:
    return 2 * np.pi / _between(rng, 0.2, 0.8), rng.uniform(0, 2 * np.pi)


def chirp(rng: Random) -> Curve:
    """A wave that becomes faster."""
    pace, phase = _wave(rng)
    faster = rng.uniform(0.5, 1.5)
    return lambda u: np.sin(pace * u * (1 + faster * u) + phase)


def beat(rng: Random) -> Curve:
    """Two waves of nearly the same period."""
    pace, phase = _wave(rng)
    other = pace * rng.uniform(1.2, 1.5)
    return lambda u: np.sin(pace * u + phase) + np.sin(other * u)


def ringing(rng: Random) -> Curve:
    """A wave that dies away."""
    pace, phase = _wave(rng)
    scale = _between(rng, 0.2, 0.8)
    return lambda u: np.exp(-u / scale) * np.sin(pace * u + phase)


def sawtooth(rng: Random) -> Curve:
    """What builds up and is reset."""
    period, phase = _between(rng, 0.2, 0.8), rng.uniform()
    return lambda u: (u / period + phase) % 1.0 - 0.5


def switching(rng: Random) -> Curve:
    """Something that goes on and off in turn."""
    pace, phase = _wave(rng)
    return lambda u: np.sign(np.sin(pace * u + phase))


def wandering(rng: Random) -> Curve:
    """A random walk."""
    places = np.linspace(-1, 3, 1001)
    path = np.cumsum(rng.standard_normal(len(places)))
    path -= np.interp(0.0, places, path)
    return lambda u: np.interp(u, places, path) / np.ptp(path[250:500])


def power(rng: Random) -> Curve:
    """A power of the distance from the start."""
    exponent = float(rng.choice([_between(rng, 0.3, 0.6), _between(rng, 3.0, 5.0)]))
    return lambda u: np.maximum(u, 0.0) ** exponent


def growth(rng: Random) -> Curve:
    """Exponential growth."""
    rate = _between(rng, 1.5, 4.0)
    return lambda u: np.expm1(rate * u) / np.expm1(rate)


def staircase(rng: Random) -> Curve:
    """Three jumps of different heights."""
    places, heights = np.sort(rng.uniform(0.1, 0.9, 3)), rng.standard_normal(3)
    return lambda u: (np.asarray(u)[:, None] > places) @ heights


def kink(rng: Random) -> Curve:
    """Two lines that meet, on both sides of where the simulation was tuned."""
    place, slope = rng.uniform(0.25, 0.75), rng.uniform(0.5, 2.0)
    return lambda u: np.where(u > place, u - place, slope * (place - u))


def dispersion(rng: Random) -> Curve:
    """What a resonance does to a phase: up and down beside a place, and slow tails."""
    place, width = rng.uniform(0.2, 0.8), _between(rng, 0.04, 0.15)
    return lambda u: 2 * (u - place) / width / (1 + ((u - place) / width) ** 2)


def transition(rng: Random) -> Curve:
    """One level that goes over into another."""
    place, width = rng.uniform(0.2, 0.8), _between(rng, 0.05, 0.2)
    return lambda u: np.tanh((u - place) / width)


CURVES: Mapping[str, Callable[[Random], Curve]] = {
    made.__name__: made
    for made in (
        chirp, beat, ringing, sawtooth, switching, wandering, power, growth, staircase, kink,
        dispersion, transition,
    )
}  # fmt: skip


def dead_time(rng: Random) -> Change:
    """A counter that is blind for a while after each count."""
    lost = _between(rng, 0.1, 1.0)
    return lambda v, u: v / (1 + lost * np.maximum(v, 0.0))


def soft_limit(rng: Random) -> Change:
    """An amplifier that is driven too far."""
    level = rng.uniform(0.5, 0.9)
    return lambda v, u: np.where(v > level, level + 0.3 * np.tanh((v - level) / 0.3), v)


def coarse_display(rng: Random) -> Change:
    """A reading in coarse steps."""
    step = _between(rng, 0.1, 0.4)
    return lambda v, u: step * np.round(v / step)


def growing_wave(rng: Random) -> Change:
    """A factor that swings, more and more."""
    pace, phase = _wave(rng)
    share = _between(rng, 0.1, 0.5)
    return lambda v, u: v * (1 + share * u * np.sin(pace * u + phase))


def dead_zone(rng: Random) -> Change:
    """A sensor that feels nothing in the middle of its range."""
    place, width = rng.uniform(0.3, 0.7), rng.uniform(0.1, 0.25)
    return lambda v, u: np.where(np.abs(v - place) < width, place, v - width * np.sign(v - place))


CHANGES: Mapping[str, Callable[[Random], Change]] = {
    made.__name__: made for made in (dead_time, soft_limit, coarse_display, growing_wave, dead_zone)
}
# beside these: what depends on the square of an input that the simulation does not know
FORMS = tuple(f"foreign: {name}" for name in (*CURVES, *CHANGES, "square_of_missing"))
