"""Every cause writes its formula in LaTeX, with the numbers of its formula in words."""

import re

import numpy as np
import pytest
from matplotlib.mathtext import MathTextParser
from scipy import stats

import hybridsurrogate as hs
from hybridsurrogate.effects.base import Context
from hybridsurrogate.effects.expressions import Code, in_latex, in_words, number, word

T = np.linspace(0, 12, 24)
CONTEXT = Context(
    X={"t_1": T, "wind 50%": np.tile([1.0, 2.0, 3.0], 8)},
    n_inputs=1,
    parameters={"rate_$": hs.truncated_normal(0.5, 0.1, 0, 1)},
    assumed={"floor{a}": hs.Assumed(10.0, stats.norm(10, 1))},
    scale=1.0,
)
CAUSES = [
    hs.Offset(),
    hs.Trend("t_1"),
    hs.Trend("t_1", degree=2),
    hs.Periodic("t_1"),
    hs.Periodic("t_1", harmonics=2),
    hs.TrendSinceStart("t_1"),
    hs.Step("t_1"),
    hs.Episode("t_1"),
    hs.Episode("t_1", factor=True),
    hs.BuildUp("t_1"),
    hs.Limit(),
    hs.Limit(below=True),
    hs.SensorResponse(),
    hs.Ramp("t_1"),
    hs.Loss("t_1"),
    hs.Bump("t_1"),
    hs.Decay("t_1"),
    hs.Saturation("t_1"),
    hs.Gain(),
    hs.WrongConstant("floor{a}"),
    *(
        hs.ParameterDrift("rate_$", "t_1", shape=shape)
        for shape in ("linear", "exponential", "step", "logistic", "periodic")
    ),
    hs.MissingInput("wind 50%"),
    hs.MissingInput("wind 50%", shape="quadratic"),
    hs.MissingInput("wind 50%", shape="categorical"),
    hs.Friction("wind 50%"),
    hs.MissingInput("wind 50%", shape="categorical", level=3),
    hs.Interaction("t_1", "wind 50%"),
    hs.Delay("t_1"),
    hs.Noise("t_1"),
    hs.GaussianProcessDiscrepancy(),
]


def parses(text):
    MathTextParser("agg").parse(f"${text}$")
    return True


def told(cause):
    """Return a number of its own for everything that the cause estimates."""
    one = np.ones(1)
    names = cause.estimates(dict.fromkeys(cause.parameters, one), dict.fromkeys(_names(cause), one))
    return {name: (-1) ** k * (1.2345 + 1.1111 * k) for k, name in enumerate(names)}


def _names(cause):
    # a smooth curve has coefficients without names of interest
    return tuple(cause.coefficients)


def numbers(text):
    bare = (
        text.replace("t_1", "")
        .replace(r"t\_1", "")
        .replace("wind 50%", "")
        .replace(r"wind 50\%", "")
    )
    return {abs(float(found)) for found in re.findall(r"\d+\.?\d*(?:e-?\d+)?", bare)}


@pytest.mark.parametrize("cause", CAUSES, ids=lambda cause: f"{cause!r}"[:60])
def test_the_numbers_in_words_are_in_latex(cause):
    prepared = cause.prepare(CONTEXT)
    values = told(prepared)
    latex = prepared.latex(values)
    assert parses(latex)
    assert latex.count("{") == latex.count("}")
    assert r"\text{simulation}" in latex
    assert numbers(prepared.formula(values)) <= numbers(latex) | {0.0}


@pytest.mark.parametrize(
    ("cause", "values"),
    [
        (hs.DynamicDrift("k_1", shape, "t"), {"amount": -0.25, "location": 3.5, **more})
        for shape, more in (
            ("step", {}),
            ("ramp", {"duration": 1.75}),
            ("logistic", {"width": 0.75}),
        )
    ]
    + [
        (hs.DynamicDrift("k_1", "periodic", "t"), {"amplitude": 0.25, "period": 3.5}),
        (hs.SecondStore("t_1", origin=0.5), {"size": 0.25, "scale": 3.5}),
        (hs.DynamicTerm("S", "constant"), {"rate": -0.25}),
        (hs.DynamicTerm("S", "proportional"), {"rate": 1.25e-6}),
        (hs.DynamicTerm("S", "seasonal"), {"amplitude": 0.25, "period": 3.5}),
        (hs.DynamicTerm("S", "power", size=4.5), {"rate": -0.25, "exponent": 1.5}),
        (hs.DynamicTerm("S", "saturating"), {"rate": -0.25, "half": 1.5}),
        (hs.DynamicTerm("S", "threshold"), {"rate": -0.25, "level": 1.5}),
        (hs.DynamicTerm("S", "product", other="T"), {"rate": 0.25}),
        (hs.DynamicDelay("S"), {"lag": 1.25}),
    ],
)
def test_causes_inside_the_dynamics(cause, values):
    latex = cause.latex(values)
    assert parses(latex)
    for value in values.values():
        assert number(abs(value)) in latex


def test_both_equations_of_a_store():
    values = {"ratio": 3.0, "scale": 0.5, "gap": 1.25}
    cause = hs.DynamicStore("S")
    said = "1.5 (store of S - S) in the slope of S and 0.5 (S - store of S) in that of the store"
    assert said in cause.formula(values)
    latex = cause.latex(values)
    assert parses(latex)
    assert latex.endswith(
        r"\frac{d}{dt} \text{store of S} = 0.5 \, \left(\text{S} - \text{store of S}\right)"
    )


def test_both_equations_of_a_store_on_which_a_term_acts():
    values = {"ratio": 3.0, "scale": 0.5, "gap": 1.25}
    cause = hs.DynamicStore("S", through="loss")
    said = (
        "1.5 (store of S - S) - term of loss in the slope of S and "
        "(1.5 (S - store of S) + term of loss at the store) / 3 in that of the store"
    )
    assert said in cause.formula(values)
    latex = cause.latex(values)
    assert parses(latex)
    assert r"- \text{term of loss}, \quad" in latex


def test_signs_and_exponents():
    assert number(123456.0) == r"1.235 \times 10^{5}"
    assert number(-0.5) == "-0.5"
    assert number(3e-7) == r"3 \times 10^{-7}"
    assert parses(number(np.inf))
    assert parses(number(np.nan))


@pytest.mark.parametrize(
    "name", ["a_b", "CO2 [%]", "a{b}", r"a\b", "x^2", "~x", "^", "m³ & $", "#"]
)
def test_any_name_can_be_written(name):
    assert parses(word(name))


def test_a_mechanism_of_ones_own_is_written_in_words():
    class AirDrag(hs.Cause):
        kind = "air_drag"

    latex = AirDrag().latex({"rate": 0.25})
    assert parses(latex)
    assert "0.25" in latex
    assert r"air\_drag" in latex


class Quench(hs.Cause):
    """A cause that a user wrote as an expression alone."""

    kind = "quench"

    def code(self):
        return Code(
            "-{size} * {u} ** 2 / (1 + np.abs({u})) + {rest} * ({x} >= {start})",
            {"size": "{y}", "rest": "{y}"},
            {"x": "t_1"},
            {"start": 4.0},
            steps={"u": "{x} - {start}"},
        )


def test_a_cause_of_ones_own_is_written_as_its_expression():
    values = {"size": 0.5, "rest": -1.25}
    expected = "simulation - 0.5 (t_1 - 4)^2 / (1 + |t_1 - 4|) - 1.25 where t_1 >= 4"
    assert Quench().formula(values) == expected
    latex = Quench().latex(values)
    assert parses(latex)
    assert r"\frac{0.5 \, \left(\text{t\_1} - 4\right)^{2}}{1 + |\text{t\_1} - 4|}" in latex
    assert latex.endswith(r"- 1.25 \, \mathbf{1}_{\text{t\_1} \geq 4}")


def test_an_expression_may_hold_anything_of_python():
    code = Code("{a} * np.where({x} % 2 == 1, {x}[0], np.sinc({x}))", {"a": "{y}"}, {"x": "t"})
    text = in_words(code, {"a": 2.0}, {})
    assert text == "simulation + 2 where(x % 2 = 1, x[0], sinc(t))"
    assert parses(in_latex(code, {"a": 2.0}, {}))


@pytest.mark.parametrize("expression", ["{size} +", "{size:.3f} * {x}"])
def test_what_cannot_be_read_is_named_with_its_numbers(expression):
    class Broken(hs.Cause):
        kind = "broken"

        def code(self):
            return Code(expression, {"size": "{y}"}, {"x": "t_1"})

    assert Broken().formula({"size": 0.5}) == "simulation with broken (size = 0.5)"
    assert parses(Broken().latex({"size": 0.5}))


def test_words_of_ones_own_are_kept():
    class Loud(Quench):
        def formula(self, values):
            return "simulation, and louder"

    class Loudest(Loud):
        def latex(self, values):
            return r"\text{loud}"

    assert Loud().latex({}) == r"\text{simulation}, \quad \text{and louder}"
    assert Loudest().latex({}) == r"\text{loud}"


def python_of(text):
    """Return a formula in words as Python, so that it can be evaluated."""
    text = re.sub(r" where (\S+) <= (\w+) < ([^,]+)", r" * ((\1 <= \2) & (\2 < \3))", text)
    text = re.sub(r" where (\w+) (>=|<) ([^,]+)", r" * (\1 \2 \3)", text)
    text = re.sub(r" where (\w+) = ([^,]+),?", r" * (\1 == \2)", text)
    return re.sub(r"(?<=[\w)]) (?=[A-Za-z(])", " * ", text.replace("^", "**"))


ADDED = [one for one in (cause.prepare(CONTEXT) for cause in CAUSES) if one.coefficients]


@pytest.mark.parametrize(
    "prepared",
    [one for one in ADDED if not one.is_process],
    ids=lambda one: f"{one.name}, {one.variant}",
)
def test_a_formula_of_what_is_added_is_the_curve(prepared):
    rng = np.random.default_rng(3)
    theta = {k: prior.ppf(rng.uniform(0.2, 0.8, 1)) for k, prior in prepared.parameters.items()}
    coefficients = {k: rng.standard_normal(1) for k in prepared.coefficients}
    values = {k: float(v[0]) for k, v in prepared.estimates(theta, coefficients).items()}
    each = {name: np.repeat(value, len(T)) for name, value in theta.items()}
    expected = prepared.columns(CONTEXT.X, each) @ np.concatenate([*coefficients.values()])
    functions = {"exp": np.exp, "cos": np.cos, "sign": np.sign, "max": np.maximum, "pi": np.pi}
    rows = {"t_1": T, "wind": CONTEXT.X["wind 50%"], "simulation": 0.0}
    text = python_of(prepared.formula(values).replace("wind 50%", "wind"))
    np.testing.assert_allclose(
        eval(text, functions, rows), expected, atol=2e-3 * np.abs(expected).max()
    )
