"""Two straight lines, and the search over causes in measurements of them."""

import numpy as np
from problems import make_problem
from scipy import stats
from searching import compared

import hybridsurrogate as hs
from hybridsurrogate.catalogue import catalogue
from hybridsurrogate.diagnosis.answers.finding import form_of
from hybridsurrogate.likelihoods import as_likelihood
from hybridsurrogate.model.context import make_context
from hybridsurrogate.model.statistics import emulator_posterior

LINE = hs.Simulator(
    lambda t, level, slope: level + slope * t,
    inputs={"t": (0, 10)},
    parameters={"level": stats.norm(1, 0.5), "slope": stats.norm(2, 0.3)},
)


LEVEL = hs.Simulator(
    lambda t, level: level + t, inputs={"t": (0, 4)}, parameters={"level": stats.norm(1, 0.5)}
)


FORMS = ("noise: mean", "noise: tails", "noise: autocorrelation")


def problem_of(X, y, simulator=LINE, noise_prior=None):
    columns = (*simulator.input_names, "extra")[: X.shape[1]]
    normal = as_likelihood("normal")
    problem = make_problem(simulator, hs.ExactSurrogate(), normal, noise_prior, (), columns, X, y)
    location = float(np.mean(y))
    n_inputs = len(simulator.input_names)
    context = make_context(
        simulator, columns, n_inputs, X, problem.scale, normal, problem.model.basis, location
    )
    return problem, context


def weigh(X, y, simulator=LINE, forms=(*FORMS, "noise", "trend", "step", "bump", "unexplained")):
    problem, context = problem_of(X, y, simulator)
    causes = [cause for cause in catalogue(context)[0] if form_of(cause) in forms]
    found = compared(problem, causes, emulator_posterior(problem.model.basis, None))
    first = found.candidates[int(np.argmax(found.probability))]
    return found, "none" if first.cause is None else first.cause.name
