"""The simulations of measured_data.py: what a scientist would write first for each data set.

Priors were written before the diagnosis was run, from what is known without the data; the comment
beside each says from what.
"""

from __future__ import annotations

import numpy as np
from scipy.special import ndtr
from scipy.stats import norm, uniform

import hybridsurrogate as hs

FEW_NODES = np.polynomial.legendre.leggauss(12)


def nile():
    """A river that does not change."""

    def flow(year, mean):
        return mean + 0 * year

    # travellers' estimates of a great river: about 1000, give or take a fifth
    return hs.Simulator(flow, {"year": (1871, 1970)}, {"mean": norm(1000, 200)})


def mauna_loa():
    """Emissions that accumulate: a quadratic in time."""

    def co2(year, level, slope, curvature):
        t = (year - 1958) / 10
        return level + slope * t + curvature * t**2

    # 315 ppm was known in 1958; emissions then were good for about 1 ppm a year, and growing
    priors = {"level": norm(315, 5), "slope": norm(10, 5), "curvature": norm(0, 3)}
    return hs.Simulator(co2, {"year": (1958, 2002)}, priors)


def enso():
    """A pressure difference that the season alone moves."""

    def difference(month, mean, cosine, sine):
        angle = 2 * np.pi * month / 12
        return mean + cosine * np.cos(angle) + sine * np.sin(angle)

    # about 10 hPa between the stations, a season of a few hPa
    priors = {"mean": norm(10, 5), "cosine": norm(0, 3), "sine": norm(0, 3)}
    return hs.Simulator(difference, {"month": (1, 168)}, priors)


def ultrasound():
    """A pulse that is absorbed."""

    def response(distance, amplitude, absorption):
        return amplitude * np.exp(-absorption * distance)

    # full scale is of order 100, absorption of order one per unit of distance
    priors = {
        "amplitude": hs.truncated_normal(100, 50, 10, 300),
        "absorption": hs.truncated_normal(0.5, 0.4, 0.01, 3),
    }
    return hs.Simulator(response, {"distance": (0.4, 6.5)}, priors)


def house():
    """A house that loses heat in proportion to the cold outside."""

    def gas(temperature, at_zero, per_degree):
        return at_zero - per_degree * temperature

    # a family house: some thousands of cubic feet a week at freezing point, none at about 18 degC
    priors = {
        "at_zero": hs.truncated_normal(6, 3, 0, 20),
        "per_degree": hs.truncated_normal(0.33, 0.2, 0, 2),
    }
    return hs.Simulator(gas, {"temperature": (-1, 11)}, priors)


def enzyme():
    """Michaelis and Menten."""

    def rate(concentration, fastest, half):
        return fastest * concentration / (half + concentration)

    # the counter reads up to some hundreds; half speed somewhere between the concentrations tried
    priors = {
        "fastest": hs.truncated_normal(200, 80, 10, 600),
        "half": hs.truncated_normal(0.1, 0.1, 0.005, 1),
    }
    return hs.Simulator(rate, {"concentration": (0.02, 1.1)}, priors)


def one_compartment():
    """A drug that leaves the blood at a constant rate."""

    def slopes(hours, state, elimination):
        return -elimination * state

    # 25 mg in a plasma volume of some ten litres; half-lives from a quarter hour to some hours
    return hs.OdeSimulator(
        slopes,
        initial_state=lambda start: [start],
        observe=lambda state: state[0],
        inputs={"hours": (0, 8)},
        parameters={
            "elimination": hs.truncated_normal(0.8, 0.5, 0.05, 4),
            "start": hs.truncated_normal(2.5, 1, 0.2, 8),
        },
        states="blood",
        output="ug/ml",
    )


def diet():
    """A patient who loses the same weight every day."""

    def slopes(day, state, loss):
        return -loss + 0 * state

    # an obese adult; diets take a few hundred grams a day
    return hs.OdeSimulator(
        slopes,
        initial_state=lambda start: [start],
        observe=lambda state: state[0],
        inputs={"day": (0, 250)},
        parameters={"loss": norm(0.3, 0.3), "start": norm(150, 40)},
        states="weight",
        output="kg",
    )


def capacitor():
    """A capacitor that discharges over a resistor."""

    def voltage(seconds, start, time_constant):
        return start * np.exp(-seconds / time_constant)

    # charged with a 9 V battery; the classroom set is built for half a second or so
    priors = {
        "start": hs.truncated_normal(9, 1, 5, 13),
        "time_constant": hs.truncated_normal(0.5, 0.3, 0.05, 3),
    }
    return hs.Simulator(voltage, {"seconds": (0, 1)}, priors)


def measles():
    """A disease that is always there."""

    def incidence(year, mean):
        return mean + 0 * year

    # nearly every child of a birth cohort of 2 %, of which about a sixth is reported
    return hs.Simulator(
        incidence, {"year": (1928, 2003)}, {"mean": hs.truncated_normal(300, 200, 1, 2000)}
    )


def supernovae():
    """Distances in a flat universe that holds nothing but matter."""

    def modulus(z, offset, matter):
        nodes, weights = FEW_NODES
        at = z[:, None] * (nodes + 1) / 2
        slowness = 1 / np.sqrt(matter[:, None] * (1 + at) ** 3 + 1 - matter[:, None])
        distance = (1 + z) * z * (slowness @ weights) / 2
        # 299792.458 km/s and 70 km/s/Mpc
        return 5 * np.log10(distance * 299792.458 / 70) + 25 + offset

    # Hubble's constant and the absolute magnitude: a third of a magnitude together
    return hs.Simulator(
        modulus,
        {"z": (0.01, 1.5)},
        {"offset": norm(0, 0.3)},
        {"matter": hs.Assumed(1.0, uniform(0.0, 1.0))},
    )


def _sir(days, contact, recovery, first, scale):
    def slopes(day, state, contact, recovery):
        new = contact * state[0] * state[1]
        return np.stack([-new, new - recovery * state[1]])

    return hs.OdeSimulator(
        slopes,
        initial_state=lambda first: [1 - first / scale, first / scale],
        observe=lambda state: np.maximum(scale * state[1], 1e-6),
        inputs={"day": days},
        parameters={"contact": contact, "recovery": recovery, "first": first},
        states=("susceptible", "infected"),
        output="infected",
        max_step=0.5,
    )


def epidemic():
    """SIR per 100,000, with constant rates."""
    # doubling in a few days, ill for one to three weeks; about 220 known cases in 60 millions
    contact = hs.truncated_normal(0.4, 0.15, 0.05, 1.5)
    recovery = hs.truncated_normal(0.1, 0.05, 0.02, 0.5)
    return _sir((0, 74), contact, recovery, hs.truncated_normal(0.4, 0.3, 0.05, 3), 1e5)


def school():
    """SIR among 763 boys, the infected in bed."""
    # influenza: contact about 1.5 a day, ill for two or three days, one or a few boys at first
    contact = hs.truncated_normal(1.5, 0.5, 0.3, 4)
    recovery = hs.truncated_normal(0.45, 0.15, 0.1, 1.5)
    return _sir((0, 14), contact, recovery, hs.truncated_normal(2, 2, 0.1, 10), 763.0)


def putting():
    """A putt is holed if it is aimed within the hole."""

    def holed(feet, sigma):
        angle = np.arcsin((0.177 - 0.07) / np.maximum(feet, 0.2))
        return 2 * ndtr(angle / np.radians(sigma)) - 1

    # professionals aim to a degree or two
    return hs.Simulator(holed, {"feet": (0, 76)}, {"sigma": hs.truncated_normal(1.5, 0.7, 0.2, 5)})


def bridge():
    """A ball falls in a vacuum; time begins where it has fallen a metre."""

    def slopes(t, state, gravity):
        return np.stack([state[1], -gravity + 0 * state[1]])

    # a metre, give or take a picture's blur; sqrt(2 g) = 4.4 m/s by then, hands may push a little
    return hs.OdeSimulator(
        slopes,
        initial_state=lambda start, speed: [start, -speed],
        observe=lambda state: state[0],
        inputs={"t": (0, 5)},
        parameters={"start": norm(-1, 0.1), "speed": norm(4.4, 0.3)},
        assumed={"gravity": hs.Assumed(9.81, hs.truncated_normal(9.81, 0.02, 9.7, 9.9))},
        states=("height", "velocity"),
        output="m",
        max_step=0.05,
    )


def classroom():
    """Time of a fall in a vacuum; the stopwatch is not questioned."""

    def fall(height, gravity):
        return np.sqrt(2 * np.maximum(height, 0) / gravity)

    # gravity is known, the building's latitude and the tape measure leave a per cent
    return hs.Simulator(
        fall, {"height": (0.1, 5)}, {"gravity": hs.truncated_normal(9.81, 0.1, 9, 10.6)}
    )


def carriage():
    """Newton: force is mass times acceleration."""

    def force(acceleration, mass):
        return mass * acceleration

    # the maker's drawing: about 100 kg
    return hs.Simulator(
        force, {"acceleration": (-10, 10)}, {"mass": hs.truncated_normal(100, 20, 20, 200)}
    )
