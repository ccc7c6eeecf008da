"""Whether a simulation is so rough that effects get lost."""

from __future__ import annotations

import warnings

import numpy as np

from hybridsurrogate.diagnosis.checks.settings import SETTINGS
from hybridsurrogate.exceptions import DiagnosisWarning
from hybridsurrogate.model.finite_differences import LONGEST_STEP, around, output
from hybridsurrogate.model.problem import Problem
from hybridsurrogate.numerics.digits import number


def warn_if_rough(problem: Problem) -> None:
    """Warn the caller of ``fit`` where the simulation jumps by much of the noise.

    Jumps are measured by second differences over the longest step around the best fit that is
    known: of independent jumps these have six times the variance.
    """
    model = problem.model
    if model.least_step < LONGEST_STEP:
        return
    ahead, behind = np.swapaxes(around(model, problem.X, problem.good, LONGEST_STEP), 0, 1)
    best = output(model, problem.X, problem.good)
    with np.errstate(invalid="ignore", over="ignore"):
        second = ahead + behind - 2 * best[:, None]
    second = second[np.isfinite(second)]
    # a simulation that fails all around its best fit has no jumps to speak of
    jump = float(np.sqrt(np.sum(second**2) / max(6 * second.size, 1)))
    noise = float(np.std(problem.y - best[0]))
    if not jump > SETTINGS.large_jump * noise:
        return
    warnings.warn(
        f"The simulation is rough: its output jumps by about {number(jump, 2)} where parameters "
        "change by a tenth of a standard deviation of their priors, and what it misses is "
        f"{number(noise, 2)}. "
        "Is the output rounded, is a solver's tolerance loose, or does it draw random numbers? "
        "Effects of this size get lost. A smoother output helps, or runs of it: "
        "simulator.run(200) with surrogate=PolynomialChaos() averages over jumps.",
        DiagnosisWarning,
        stacklevel=4,
    )
