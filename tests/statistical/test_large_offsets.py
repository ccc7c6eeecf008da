"""Outputs and inputs far from zero, or in units that make them tiny or huge.

A constant added to the simulation and to the measurements alike is no fault of the simulation:
absolute pressures, Julian dates and frequencies must get the verdict that they get near zero. All
nine data sets in all units, as a table: ``python tests/statistical/test_large_offsets.py``; names
after it choose some. Here each is tried at a far level and in other units.
"""

from __future__ import annotations

import sys
import warnings
from typing import NamedTuple

import numpy as np
import pandas as pd
import pytest
from scipy import stats

import hybridsurrogate as hs

pytestmark = pytest.mark.statistical

SLOPE = {"slope": hs.truncated_normal(1, 0.3, 0, 2)}


class Scale(NamedTuple):
    """Units of y and x, and where they begin: ``unit * (start + y)``, starts in these units."""

    start: float = 0.0
    unit: float = 1.0
    x_start: float = 0.0
    x_unit: float = 1.0

    @property
    def is_lost(self):
        """Whether doubles hold less than a millionth of the spread, which is 0.6 to 6."""
        return max(self.start, self.x_start) > 1e11

    def out(self, y):
        return self.unit * (self.start + y)

    def x(self, x):
        return self.x_unit * (self.x_start + x)

    def back(self, x):
        return x / self.x_unit - self.x_start

    def simulator(self, function, parameters, assumed=None):
        """Return the simulation of ``function(x, ...)`` on x from 0 to 20 in these units."""
        ends = (self.x(0.0), self.x(20.0))

        def scaled(x, **omega):
            return self.out(function(self.back(x), **omega))

        return hs.Simulator(scaled, {"x": ends}, parameters, assumed=assumed)


def rows(seed, n=40):
    rng = np.random.default_rng(seed)
    return np.sort(rng.uniform(0, 20, n)), rng.standard_normal(n)


def line(x, slope):
    return slope * x


def nothing(scale):
    x, z = rows(1)
    return scale.simulator(line, SLOPE), hs.ExactSurrogate(), x, 1.05 * x + 0.4 * z


def offset_of_runs(scale):
    """Runs made elsewhere, of which the default surrogate is an emulator."""
    x, z = rows(2)
    runs = scale.simulator(line, SLOPE).run(60, random_state=0)
    runs = hs.SimulationData(runs.X, runs.omega, runs.y, runs.input_ranges, SLOPE)
    return runs, None, x, 1.05 * x + 2.0 + 0.4 * z


def step_of_polynomial(scale):
    x, z = rows(3)
    runs = scale.simulator(lambda x, slope: slope * np.sin(x / 4), SLOPE).run(100, random_state=0)
    y = 1.1 * np.sin(x / 4) + 0.8 * (x > 11) + 0.15 * z
    return runs, hs.PolynomialChaos(degree=6), x, y


def wave(scale):
    x, z = rows(4)
    y = 1.05 * x + 1.2 * np.sin(2 * np.pi * x / 4.3) + 0.4 * z
    return scale.simulator(line, SLOPE), hs.ExactSurrogate(), x, y


def wrong_constant(scale):
    x, z = rows(5, 60)

    def relaxing(x, amplitude, rate):
        return 10 * amplitude * np.exp(-rate * x)

    assumed = {"rate": hs.Assumed(0.2, stats.uniform(0.05, 0.6))}
    simulator = scale.simulator(relaxing, {"amplitude": SLOPE["slope"]}, assumed)
    return simulator, hs.ExactSurrogate(), x, relaxing(x, 1.1, 0.35) + 0.2 * z


def noise(scale):
    x, z = rows(6, 80)
    y = 1.05 * x + 0.1 * np.exp(x / 5) * z
    return scale.simulator(line, SLOPE), hs.ExactSurrogate(), x, y


def bump_of_kriging(scale):
    x, z = rows(7)
    runs = scale.simulator(lambda x, slope: slope * np.tanh(x - 8), SLOPE).run(80, random_state=0)
    y = np.tanh(x - 8) + 1.5 * np.exp(-0.5 * ((x - 14) / 1.2) ** 2) + 0.15 * z
    return runs, hs.Kriging(), x, y


def trend_of_ode(scale):
    """A body that cools towards its surroundings; the level is that of the state itself."""
    x, z = rows(8)

    def cooling(t, state, rate):
        return -rate / (5 * scale.x_unit) * (state - scale.out(0.0))

    simulator = hs.OdeSimulator(
        cooling,
        initial_state=lambda rate: [scale.out(10.0) + 0 * rate],
        observe=lambda state: state[0],
        inputs={"x": (scale.x(0.0), scale.x(20.0))},
        parameters={"rate": SLOPE["slope"]},
        states=("temperature",),
    )
    return simulator, hs.ExactSurrogate(), x, 10 * np.exp(-1.1 * x / 5) + 0.15 * x + 0.2 * z


def lognormal_wave(scale):
    """On a logarithmic scale a unit is an added constant; there is no other one."""
    x, z = rows(9)

    def growth(x, slope):
        return np.exp(0.2 * slope * x)

    y = growth(x, 1.1) * np.exp(0.4 * np.sin(2 * np.pi * x / 5.1) + 0.15 * z)
    return scale.simulator(growth, SLOPE), hs.ExactSurrogate(), x, y


CASES = (
    nothing,
    offset_of_runs,
    step_of_polynomial,
    wave,
    wrong_constant,
    noise,
    bump_of_kriging,
    trend_of_ode,
    lognormal_wave,
)
# outputs begin at 0 to 1e9 in the user's units, or at 0 to 1e9 of their own
SCALES = [
    *(Scale(start=start) for start in (1e3, 1e6, 1e9, 1e12)),
    *(Scale(start, 1e-9) for start in (0.0, 1e6, 1e9, 1e15, 1e18)),
    *(Scale(start, 1e9) for start in (0.0, 1.0, 1e6, 1e9)),
    *(Scale(x_start=start) for start in (2.45e6, 1e9, 1e12)),
    *(Scale(x_unit=unit) for unit in (1e-9, 1e9)),
    Scale(1e6, 1e-9, 2.45e6, 1e9),
]
# a slice of them: far outputs, tiny ones far away, huge ones, both axes elsewhere
FEW = [Scale(1e9), Scale(1e18, 1e-9), Scale(0.0, 1e9), Scale(1e6, 1e-9, 2.45e6, 1e9)]


def diagnose(case, scale):
    simulation, surrogate, x, y = case(scale)
    model = hs.PowerScaledSurrogate(
        simulation,
        surrogate=surrogate,
        likelihood="lognormal" if case is lognormal_wave else "normal",
        n_draws=200,
        random_state=0,
    )
    X = pd.DataFrame({"x": scale.x(x)})
    return hs.DiscrepancyDiagnosis(model, cv=None, random_state=0).fit(X, scale.out(y))


def told(case, scale):
    """Return verdict, kind and the kind's probability; a refusal in words is its own verdict."""
    try:
        found = diagnose(case, scale)
    except ValueError as error:
        if "double precision" not in str(error):
            raise
        return "refused", "", np.nan
    return found.verdict_, found.best_cause_.kind, found.best_cause_.probability


def fits(case, scale):
    """Return whether a scale is one for the case."""
    return case is not lognormal_wave or scale.start == 0


def agrees(case, scale, first):
    """Return whether a scale makes no difference, and what the case gets there."""
    here = told(case, scale)
    return here[0] == "refused" if scale.is_lost else here[:2] == first[:2], here


@pytest.mark.slow
@pytest.mark.parametrize(
    ("case", "scale"),
    [
        (nothing, Scale(1e6)),
        (nothing, Scale(1e9)),
        (step_of_polynomial, Scale(1e6, 1e-9, 2.45e6, 1e9)),
        (wave, Scale(1e9, 1e-9, 2.45e6)),
    ],
)
@pytest.mark.filterwarnings("ignore::hybridsurrogate.HybridSurrogateWarning")
def test_a_common_level_changes_no_verdict(case, scale):
    first = told(case, Scale())
    expected = {nothing: "none", step_of_polynomial: "step", wave: "periodic"}[case]
    assert first[1] == expected
    assert agrees(case, scale, first)[0]


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::hybridsurrogate.HybridSurrogateWarning")
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.__name__)
def test_no_level_and_no_unit_changes_a_verdict(case):
    first = told(case, Scale())
    # an ODE is slow: tiny outputs far away, and both axes elsewhere
    scales = FEW[1::2] if case is trend_of_ode else FEW
    found = {scale: agrees(case, scale, first) for scale in scales if fits(case, scale)}
    assert {scale: here for scale, (same, here) in found.items() if not same} == {}


@pytest.mark.parametrize(
    ("scale", "what"),
    [
        (Scale(1e12), "The measured outputs"),
        (Scale(1e18), "All measured outputs are 1e\\+18"),
        (Scale(x_start=1e12), "The values of 'x'"),
    ],
)
def test_digits_that_are_lost_are_told(scale, what):
    with pytest.raises(ValueError, match=f"^{what}.*double precision.*[Ss]ubtract a constant"):
        diagnose(nothing, scale)


def test_runs_that_are_all_the_same_for_their_digits_are_lost_are_told():
    """Kriging ended in a LinAlgError before the diagnosis saw the measured outputs."""
    with pytest.raises(
        ValueError, match=r"^All measured outputs are 1000000000: .*double precision"
    ):
        diagnose(bump_of_kriging, Scale(1e18, 1e-9))


@pytest.mark.slow
@pytest.mark.parametrize("level", [0.0, 1e6, 1e7])
def test_a_wide_prior_of_the_level_hides_nothing(level):
    """It sets the level, as far from its prior's centre as the level is from zero."""
    x, z = rows(4)
    parameters = {"base": stats.norm(0, max(level, 10.0)), **SLOPE}
    simulator = hs.Simulator(
        lambda x, base, slope: base + slope * x, {"x": (0, 20)}, parameters=parameters
    )
    model = hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), n_draws=200, random_state=0
    )
    y = level + 1.05 * x + 1.5 * np.sin(2 * np.pi * x / 4.3) + 0.4 * z
    found = hs.DiscrepancyDiagnosis(model, cv=None, random_state=0).fit(x[:, None], y)
    assert (found.verdict_, found.best_cause_.kind) == ("named", "periodic")


@pytest.mark.parametrize("method", ["rk4", "RK45", "DOP853", "LSODA", "BDF"])
@pytest.mark.parametrize("level", [0.0, 1e3, 1e9])
def test_a_state_far_from_zero_is_solved_as_well(method, level):
    simulator = hs.OdeSimulator(
        lambda t, state, rate: -rate * (state - level),
        initial_state=lambda rate: [level + 10 + 0 * rate],
        observe=lambda state: state[0],
        inputs={"t": (0, 20)},
        parameters={"rate": stats.uniform(0.1, 0.3)},
        states=("temperature",),
        method=method,
    )
    t = np.linspace(0, 20, 9)
    told = simulator(t[:, None], np.full((9, 1), 0.22))
    # in shares of what happens; doubles around 1e9 are 1.2e-7 apart
    np.testing.assert_allclose(told - level, 10 * np.exp(-0.22 * t), rtol=0, atol=1e-5)


@pytest.mark.parametrize("level", [0.0, 1e9])
def test_the_step_suits_a_state_far_from_zero(level):
    """It was four times as long, as errors were shares of the level."""
    simulator = hs.OdeSimulator(
        lambda t, state, rate: rate * (np.sin(60 * t) - (state - level)),
        initial_state=[level],
        observe=lambda state: state[0],
        inputs={"t": (0, 20)},
        parameters={"rate": stats.uniform(20, 50)},
        states=("pressure",),
    )
    t, rate = np.linspace(0, 20, 41), 45.0
    told = simulator(t[:, None], np.full((41, 1), rate)) - level
    # of s' = r (sin w t - s), s(0) = 0
    wave = rate * np.sin(60 * t) - 60 * np.cos(60 * t) + 60 * np.exp(-rate * t)
    np.testing.assert_allclose(told, rate * wave / (rate**2 + 60**2), rtol=0, atol=1e-4)


def table(names):
    """Print what cases get at every scale: those named, or all."""
    warnings.simplefilter("ignore")
    different = 0
    for case in (case for case in CASES if not names or case.__name__ in names):
        first = told(case, Scale())
        print(f"{case.__name__:20} {first[0]:10} {first[1]:16} {first[2]:.3f}", flush=True)
        for scale in (scale for scale in SCALES if fits(case, scale)):
            same, here = agrees(case, scale, first)
            different += not same
            name = " ".join(f"{value:g}" for value in scale)
            mark = "" if same else "  <- differs"
            print(f"    {name:24} {here[0]:10} {here[1]:16} {here[2]:.3f}{mark}", flush=True)
    print(f"{different} differ")


if __name__ == "__main__":
    table(sys.argv[1:])
