"""The scientist's own causes for measured_data.py, where the catalogue has none of that form.

Formulas are the documented ones; priors are what the field knew without these data, and the comment
beside each says from what.
"""

from __future__ import annotations

import numpy as np
from scipy.special import ndtr
from scipy.stats import halfnorm, loguniform

import hybridsurrogate as hs


class ElNino(hs.Cause):
    """Two cycles whose periods have nothing to do with each other or with the year."""

    kind = "el-nino"
    target = "month"
    # El Niño comes back every three to seven years, beside it goes a quasi-biennial cycle
    parameters = {"slow": loguniform(36, 84), "fast": loguniform(20, 36)}
    coefficients = ("slow_sine", "slow_cosine", "fast_sine", "fast_cosine")

    def columns(self, X, theta):
        angles = [2 * np.pi * X["month"] / theta[name] for name in ("slow", "fast")]
        return np.stack([wave(angle) for angle in angles for wave in (np.sin, np.cos)], axis=-1)


class BeamSpreading(hs.Cause):
    """The pulse spreads while it is absorbed: a factor 1 / (1 + rate x)."""

    kind = "beam-spreading"
    target = "distance"
    # none to all of it within the block
    parameters = {"rate": loguniform(0.05, 20)}

    def gain(self, X, theta):
        return 1 / (1 + theta["rate"] * X["distance"])


class DistanceControl(hs.Cause):
    """A putt must also end within three feet behind the hole; one foot is aimed at."""

    kind = "distance-control"
    target = "feet"
    # the relative error of the length of a professional's putt
    parameters = {"spread": halfnorm(scale=0.2)}

    def gain(self, X, theta):
        error = (X["feet"] + 1) * np.maximum(theta["spread"], 1e-6)
        return ndtr(2 / error) - ndtr(-1 / error)


class AirDrag(hs.Cause):
    """Drag that grows with the square of the speed, which ends at a terminal one."""

    kind = "air-drag"
    target = "height"
    # a shuttlecock's 7 m/s to a cannon ball's 100
    parameters = {"terminal": loguniform(5, 100)}

    def inputs(self, X, omega, theta):
        height, gravity = np.maximum(X["height"], 1e-9), omega["gravity"]
        terminal = theta["terminal"]
        time = terminal / gravity * np.arccosh(np.exp(gravity * height / terminal**2))
        # in a vacuum with this gravity the fall takes as long
        return X, {**omega, "gravity": 2 * height / time**2}


class FiniteSurface(hs.Cause):
    """A surface fills up: ``1 - exp(-filled x)`` where it is ``filled x`` at first (Misra 1978)."""

    kind = "finite-surface"
    target = "pressure"
    # the surface is as good as full at a tenth of the highest pressure, or hardly touched by it
    parameters = {"filled": loguniform(1e-5, 0.05)}

    def gain(self, X, theta):
        share = np.maximum(theta["filled"] * X["pressure"], 1e-12)
        return -np.expm1(-share) / share


class Accelerated(hs.Cause):
    """A rate that grows exponentially with the temperature (Nelson 1981)."""

    kind = "accelerated"
    target = "temperature"
    # a rule of chemistry: twice as fast every ten degrees, give or take a factor of two
    parameters = {"per_degree": halfnorm(scale=0.1)}

    def inputs(self, X, omega, theta):
        factor = np.exp(theta["per_degree"] * (X["temperature"] - 225))
        return X, {**omega, "rate": omega["rate"] * factor}
