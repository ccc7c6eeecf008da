"""The extended model as Python: what is written, imported, is the extended simulator."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from tide import FRAME, SIMULATOR, context_of, problem_of

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.answers.python_code import (
    ExtendedModel,
    FittedCause,
    python_source,
)
from hybridsurrogate.diagnosis.validation.refit import extended_simulator
from hybridsurrogate.effects.base import NOISE_SD
from hybridsurrogate.effects.registry import FORMS
from hybridsurrogate.likelihoods import as_likelihood

SIGMA = 0.3


def imported(source):
    """Return the names that a module of this source has; it may import numpy and scipy only."""
    module = {}
    exec(compile(source, "extended.py", "exec"), module)
    return module


def drawn(cause, values, coefficients, model, k):
    """Return one draw of a cause's numbers as those of a fit."""
    theta = {
        name: values[:, model.n_parameters + j]
        for j, (owner, name) in enumerate(model.theta_names)
        if owner == k
    }
    own = {
        name: coefficients[:, j] for j, (owner, name) in enumerate(model.column_names) if owner == k
    }
    if cause.follows_slope:
        theta[NOISE_SD] = np.array([SIGMA])
    return FittedCause(cause, theta, own)


def written(problem, causes, seed=0, simulator=SIMULATOR, **changes):
    """Return a module of causes at random numbers, and the model and the draw behind it."""
    rng = np.random.default_rng(seed)
    model = problem.model.with_effects(causes)
    values = model.values(0.5 * rng.standard_normal((1, model.n_unknowns)))
    coefficients = rng.standard_normal((1, len(model.column_sd)))
    extended = ExtendedModel(
        name=simulator.name,
        inputs=simulator.input_names,
        outputs=simulator.outputs,
        parameters={name: values[:, j] for j, name in enumerate(model.parameters)},
        assumed={name: constant.value for name, constant in simulator.assumed.items()},
        causes=[drawn(c, values, coefficients, model, k) for k, c in enumerate(causes)],
        likelihood=problem.likelihood,
        sigma={name: np.array([SIGMA]) for name in simulator.outputs},
        simulator=simulator,
    )
    return replace(extended, **changes), model, values, coefficients


def of_catalogue():
    """Yield a cause for every form of the catalogue that this simulation can have."""
    context = context_of()
    for name, form in FORMS.items():
        for cause in form.propose(context):
            yield pytest.param(name, cause, id=name)
            break


def columns_of(module):
    code = module["extended"].__code__
    return [name for name in code.co_varnames[: code.co_argcount] if name in FRAME]


@pytest.mark.parametrize(("name", "cause"), list(of_catalogue()))
def test_each_form_is_the_extended_simulator(name, cause):
    problem = problem_of(FRAME, np.zeros(len(FRAME)))
    causes = [cause.prepare(context_of())]
    extended, model, values, coefficients = written(problem, causes)
    module = imported(python_source(extended))
    rows = {column: FRAME[column].to_numpy() for column in columns_of(module)}
    found = module["extended"](SIMULATOR.function, **rows)
    parts = model.parts(problem.X, values)
    expected = parts.known[0]
    if causes[0].changes_output:
        expected = expected + parts.columns[0] @ coefficients[0]
    np.testing.assert_allclose(found, expected, rtol=1e-6)
