"""A cause around another one, and what causes act on."""

import pytest
from tide import context_of

import hybridsurrogate as hs
from hybridsurrogate.effects.base import Cause, Wrapped

STEP = hs.Step("t").prepare(context_of())


@pytest.mark.parametrize(
    "name",
    ["kind", "variant", "parameters", "coefficients", "coefficient_sd", "reads", "changes_output"],
)
def test_what_a_wrapper_does_not_override_is_that_of_the_cause(name):
    assert getattr(hs.InOutput(STEP, "q"), name) == getattr(STEP, name)


def test_every_public_name_of_a_cause_is_forwarded():
    """One that is added to Cause needs no second line."""
    own = {"filled", "prepare", "output", "inner", "unit_of_output"}
    public = {name for name in vars(Cause) if not name.startswith("_")}
    assert public - own <= vars(Wrapped).keys()


def test_methods_are_those_of_the_cause():
    wrapped = Wrapped(STEP)
    assert wrapped.grid()["location"].tolist() == STEP.grid()["location"].tolist()
    values = {"location": 3.0, "amplitude": 0.5}
    assert wrapped.formula(values) == STEP.formula(values)
    assert wrapped.latex(values) == STEP.latex(values)


def test_a_cause_knows_its_output():
    assert STEP.output is None
    assert STEP.inner is STEP
    assert STEP.unit_of_output == 1.0
    inside = hs.InOutput(STEP, "q", 1, 4.0)
    assert (inside.output, inside.inner, inside.unit_of_output) == ("q", STEP, 4.0)
    assert inside.target == "q: t"


class Bent(hs.Gain):
    """A user's cause that makes more of the output than its factor."""

    def response(self, simulated, X, theta):
        return theta["gain"] * simulated**3, 3 * theta["gain"] * simulated**2


@pytest.mark.parametrize(
    ("cause", "acts"),
    [
        (hs.Step("t"), set()),
        (hs.Gain(), {"gain"}),
        (hs.BuildUp("t"), {"gain"}),
        (hs.Limit(), {"response"}),
        (Bent(), {"gain", "response"}),
        (hs.Delay("t"), {"inputs"}),
        (hs.Noise("t"), {"noise"}),
        (hs.Outliers(), {"outliers"}),
        (hs.Overdispersion(), {"noise", "overdispersion"}),
        (hs.InOutput(hs.Noise("t"), "q"), {"noise"}),
        (hs.InOutput(hs.Overdispersion(), "q"), {"noise"}),
    ],
    ids=lambda value: value.name if isinstance(value, Cause) else " and ".join(sorted(value)),
)
def test_what_a_cause_acts_on(cause, acts):
    assert cause.acts_on == acts
    assert cause.touches_simulation is bool(acts & {"inputs", "gain", "response"})
