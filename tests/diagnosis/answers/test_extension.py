"""Several causes in one simulation: the extended simulator is the model that was fitted."""

import numpy as np
import pytest
from tide import FRAME, SIMULATOR, context_of, problem_of

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.answers.extension import ExtendedFunction
from hybridsurrogate.diagnosis.validation.refit import extended_simulator

DRIFT = hs.ParameterDrift("height", "t", shape="step")
COMBINATIONS = {
    "delay, drift": (hs.Delay("t"), DRIFT),
    "drift, delay": (DRIFT, hs.Delay("t")),
    "wave, delay": (hs.Periodic("t"), hs.Delay("t")),
    "gain, delay, trend": (hs.Gain(), hs.Delay("t"), hs.Trend("t")),
    "constant, drift, delay": (hs.WrongConstant("floor"), DRIFT, hs.Delay("t")),
    "three waves": (hs.Periodic("t"), hs.Periodic("dose"), hs.Periodic("wind")),
    "two drifts, two slopes": (
        hs.ParameterDrift("height", "t"),
        hs.ParameterDrift("rate", "wind"),
        hs.MissingInput("wind"),
        hs.MissingInput("batch"),
    ),
}


@pytest.mark.parametrize("effects", COMBINATIONS.values(), ids=COMBINATIONS)
def test_several_causes_together(effects):
    rng = np.random.default_rng(0)
    problem = problem_of(FRAME, np.zeros(len(FRAME)))
    causes = [cause.prepare(context_of()) for cause in effects]
    model = problem.model.with_effects(causes)
    values = model.values(0.5 * rng.standard_normal((1, model.n_unknowns)))
    coefficients = rng.standard_normal(len(model.column_sd))
    parts = model.parts(problem.X, values)
    fitted = parts.known[0] + parts.columns[0] @ coefficients

    extended = extended_simulator(SIMULATOR, causes, problem)
    numbers = dict(zip(model.parameters, values[0], strict=False))
    numbers |= public_numbers(extended, model, values[0], coefficients)
    # no two numbers share a name
    assert len(numbers) == len(extended.parameter_names) == values.shape[1] + len(coefficients)
    omega = [numbers[name] for name in extended.parameter_names]
    X = FRAME[list(extended.input_names)].to_numpy()
    run = extended(X, np.tile(omega, (len(X), 1)))
    np.testing.assert_allclose(run, fitted, rtol=1e-10)


def public_numbers(extended, model, values, coefficients):
    """Return the causes' numbers by their names in the extended simulator."""
    out, function = {}, extended.function
    while isinstance(function, ExtendedFunction):
        k = [cause is function.cause for cause in model.effects].index(True)
        for names, given, numbers in (
            (function.theta_names, model.theta_names, values[model.n_parameters :]),
            (function.coefficient_names, model.column_names, coefficients),
        ):
            own = dict(zip(given, numbers, strict=True))
            out |= {public: own[k, name] for name, public in names.items()}
        function = function.simulator.function
    return out
