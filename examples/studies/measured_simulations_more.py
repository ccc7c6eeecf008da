"""The simulations of measured_data.py --more: what a scientist would write first for each data set.

Priors were written before the diagnosis was run, from what is known without the data; the comment
beside each says from what.
"""

from __future__ import annotations

import numpy as np
from scipy.stats import norm

import hybridsurrogate as hs

positive = hs.truncated_normal


def ebola():
    """SEIR with a constant contact rate; onsets are those whose latent time ends."""
    people = 5_364_500.0

    def slopes(day, state, contact, latent, ill):
        susceptible, exposed, infectious = state
        new = contact * susceptible * infectious / people
        return np.stack([-new, new - exposed / latent, exposed / latent - infectious / ill])

    return hs.OdeSimulator(
        slopes,
        initial_state=lambda first: [people - 2 * first, first, first],
        observe=lambda state, latent: np.maximum(state[1] / latent, 1e-6),
        inputs={"day": (54, 200)},
        # each case infects one to four others in a week; a few cases hide in the first of March
        parameters={"contact": positive(0.4, 0.2, 0.02, 2), "first": positive(2, 3, 0.01, 30)},
        # of earlier outbreaks: an incubation of 2 to 21 days, a week until death or recovery
        assumed={
            "latent": hs.Assumed(5.3, positive(5.3, 2, 1, 21)),
            "ill": hs.Assumed(5.61, positive(5.61, 2, 1, 21)),
        },
        states=("susceptible", "exposed", "infectious"),
        output="onsets",
        max_step=0.5,
    )


def chamber():
    """A rat in a closed chamber breathes in a solvent that its tissues take up, and keep.

    Physiology and partition coefficients of Evans et al. (1994), as in deSolve's ccl4model.
    """
    weight, air, breath, heart = 0.182, 3.8 - 0.182, 4.0, 4.0
    shares = np.array([[0.74], [0.05], [0.08], [0.04]])  # muscle, viscera, fat, liver
    flows = heart * np.array([[0.32], [0.48], [0.05], [0.15]])
    blood_air = 5.487
    tissue_blood = np.array([[13.3], [16.17], [281.48], [16.17]]) / blood_air
    mg_per_ppm = air * 153.8 / 24450

    def slopes(hours, state, leak):
        venous = state[1:] / (shares * weight * tissue_blood)
        inhaled = state[0] / air
        arterial = (np.sum(flows * venous, axis=0) + breath * inhaled) / (
            heart + breath / blood_air
        )
        chamber = breath * (arterial / blood_air - inhaled) - leak * state[0]
        return np.concatenate([chamber[None], flows * (arterial - venous)])

    return hs.OdeSimulator(
        slopes,
        initial_state=lambda ppm, filled: [filled * ppm * mg_per_ppm, 0, 0, 0, 0],
        observe=lambda state: np.maximum(state[0] / mg_per_ppm, 1e-6),
        inputs={"hours": (0, 6), "ppm": (25, 1000)},
        # what is injected is known to a tenth or so
        parameters={"filled": positive(1, 0.1, 0.5, 1.5)},
        # measured in the empty chamber
        assumed={"leak": hs.Assumed(0.02, positive(0.02, 0.01, 0, 0.1))},
        states=("chamber", "muscle", "viscera", "fat", "liver"),
        output="ppm in the chamber",
        max_step=0.03,  # the viscera take a minute
    )


def tanks(volts):
    """Two tanks, one above the other, by Bernoulli; ``volts`` of the pump by record and sample."""

    seconds = 4.0 * np.arange(volts.shape[1])

    def slopes(t, state, record, out, into, drain, pump):
        upper, lower = np.sqrt(np.maximum(state, 0))
        driven = np.array([np.interp(t, seconds, series) for series in volts])
        driven = driven[np.asarray(record, dtype=int)]
        return np.stack([pump * driven - out * upper, into * upper - drain * lower])

    # levels settle within minutes, in volts of a sensor that reads up to ten
    rates = dict.fromkeys(("out", "into", "drain", "pump"), positive(0.05, 0.04, 0.005, 0.4))
    levels = dict.fromkeys(("first", "second"), positive(5, 3, 0, 10))
    return hs.OdeSimulator(
        slopes,
        initial_state=lambda first, second: [first, second],
        observe=lambda state: state[1],
        inputs={"seconds": (0, 4096), "record": (0, 1)},
        parameters={**rates, **levels},
        states=("upper", "lower"),
        output="volts",
        max_step=8.0,  # the pump's waves take 70 s and more
    )


def henry():
    """What is adsorbed is in proportion to the pressure."""

    def adsorbed(pressure, solubility):
        return solubility * pressure

    # a first reading: about a seventh of the pressure
    priors = {"solubility": positive(0.15, 0.1, 0, 1)}
    return hs.Simulator(adsorbed, {"pressure": (0, 800)}, priors)


def ageing():
    """Insulation loses strength at the same rate whatever the temperature."""

    def strength(weeks, new, rate):
        return new * np.exp(-rate * weeks)

    # new material holds some 15 kV; the plan of the trial expects it to halve within a year or so
    priors = {"new": positive(15, 5, 2, 40), "rate": positive(0.02, 0.03, 0, 0.3)}
    return hs.Simulator(strength, {"weeks": (0, 64)}, priors)


def dialyzer():
    """Ultrafiltration grows with the pressure, up to what the membrane lets through."""

    def filtered(pressure, plateau, steep, osmotic):
        return plateau * (1 - np.exp(-steep * (pressure - osmotic)))

    # high-flux membranes: about 50 ml/h at a pressure of a few dmHg; proteins hold back 20 mmHg
    priors = {
        "plateau": positive(50, 20, 5, 150),
        "steep": positive(1, 0.7, 0.05, 5),
        "osmotic": norm(0.2, 0.2),
    }
    return hs.Simulator(filtered, {"pressure": (0.2, 3.1)}, priors)


def _casualties(usual):
    def hurt(month, km, petrol, level, winter, spring, half_winter, half_spring, traffic, price):
        angle = 2 * np.pi * month / 12
        season = winter * np.cos(angle) + spring * np.sin(angle)
        season = season + half_winter * np.cos(2 * angle) + half_spring * np.sin(2 * angle)
        return level * np.exp(season) * (km / 15_000) ** traffic * (petrol / 0.1) ** price

    # seasons of a fifth; elasticities of order one, of traffic rather up, of the price rather down
    season = norm(0, 0.2)
    priors = {
        "level": positive(usual, usual / 2, usual / 10, 5 * usual),
        "winter": season, "spring": season, "half_winter": season, "half_spring": season,
        "traffic": norm(0.5, 1), "price": norm(-0.3, 0.7),
    }  # fmt: skip
    inputs = {"month": (0, 192), "km": (7_000, 22_000), "petrol": (0.08, 0.14)}
    return hs.Simulator(hurt, inputs, priors)


def front_seats():
    """Passengers in front, from the season, the traffic and the price of petrol."""
    return _casualties(800)


def rear_seats():
    """Passengers in the rear, likewise."""
    return _casualties(400)


def mug():
    """Newton's law of cooling."""

    def slopes(minute, state, rate, room):
        return -rate * (state - room)

    # a mug is cold after an hour or so; just off the boil; a room
    return hs.OdeSimulator(
        slopes,
        initial_state=lambda start: [start],
        observe=lambda state: state[0],
        inputs={"minute": (0, 222)},
        parameters={
            "rate": positive(0.03, 0.02, 0.002, 0.3),
            "start": positive(97, 5, 70, 101),
            "room": positive(22, 5, 5, 40),
        },
        states="water",
        output="temperature",
    )


def stormer():
    """A rotor without friction: the time is in proportion to viscosity over weight."""

    def seconds(viscosity, weight, factor):
        return factor * viscosity / weight

    # of this make of instrument: some tens
    priors = {"factor": positive(30, 20, 1, 150)}
    return hs.Simulator(seconds, {"viscosity": (10, 300), "weight": (15, 110)}, priors)


def beaver():
    """A warm-blooded animal keeps its temperature."""

    def temperature(step, mean):
        return mean + 0 * step

    return hs.Simulator(temperature, {"step": (0, 99)}, {"mean": norm(37, 1)})


def calls():
    """Calls grow by the same number each year."""

    def made(year, start, growth):
        return start + growth * (year - 1950)

    # in tens of millions: a country of nine million people, of whom few telephone abroad
    priors = {"start": norm(5, 5), "growth": norm(1, 2)}
    return hs.Simulator(made, {"year": (1950, 1973)}, priors)


def gravity():
    """One constant."""

    def g(row, mean):
        return mean + 0 * row

    # the Potsdam system, carried over to Washington, was in doubt by some hundredths of cm/s^2
    return hs.Simulator(g, {"row": (0, 81)}, {"mean": norm(100, 50)})


def predators():
    """Lotka and Volterra."""

    def slopes(year, state, birth, eaten, death, growth):
        hare, lynx = state
        return np.stack([(birth - eaten * lynx) * hare, (growth * hare - death) * lynx])

    # priors of Carpenter's (2018) case study
    return hs.OdeSimulator(
        slopes,
        initial_state=lambda hares, lynxes: [hares, lynxes],
        observe=lambda state: {
            "hare": np.maximum(state[0], 1e-9), "lynx": np.maximum(state[1], 1e-9)
        },
        inputs={"year": (1900, 1920)},
        parameters={
            "birth": positive(1, 0.5, 0.01, 3),
            "eaten": positive(0.05, 0.05, 0.001, 0.5),
            "death": positive(1, 0.5, 0.01, 3),
            "growth": positive(0.05, 0.05, 0.001, 0.5),
            "hares": positive(20, 20, 1, 150),
            "lynxes": positive(10, 10, 0.5, 80),
        },
        states=("hares", "lynxes"),
        output=("hare", "lynx"),
    )  # fmt: skip


def demand():
    """Electricity for heating below 18 degC, and for cooling above."""

    def used(temperature, base, heating, cooling):
        cold, hot = np.maximum(18 - temperature, 0), np.maximum(temperature - 18, 0)
        return base + heating * cold + cooling * hot

    # sums of half hours, twice GWh: about 4.5 GW all day, some per cent more a degree
    priors = {
        "base": norm(215, 40),
        "heating": positive(4, 4, 0, 20),
        "cooling": positive(4, 4, 0, 20),
    }
    return hs.Simulator(used, {"temperature": (5, 45)}, priors)


def drug():
    """A dose that is in the blood at once, and leaves it at a constant rate."""

    def concentration(hours, dose, elimination, volume):
        return dose / volume * np.exp(-elimination * hours)

    # theophylline: half a litre a kilogram, a half-life of 4 to 16 hours
    priors = {
        "elimination": positive(0.09, 0.05, 0.01, 0.5),
        "volume": positive(0.5, 0.2, 0.1, 2),
    }
    return hs.Simulator(concentration, {"hours": (0, 25), "dose": (3, 6)}, priors)


def malthus():
    """A population that grows at a constant rate."""

    def slopes(year, state, growth):
        return growth * state

    # Malthus: doubled in 25 years; the census counted about four millions
    return hs.OdeSimulator(
        slopes,
        initial_state=lambda start: [start],
        observe=lambda state: np.maximum(state[0], 1e-9),
        inputs={"year": (1790, 1950)},
        parameters={"growth": positive(0.028, 0.01, 0, 0.1), "start": positive(4, 1, 0.5, 10)},
        states="population",
        output="millions",
    )


def disasters():
    """Disasters at a constant rate."""

    def rate(year, mean):
        return mean + 0 * year

    # some a year
    return hs.Simulator(rate, {"year": (1851, 1962)}, {"mean": positive(3, 3, 0.05, 20)})
