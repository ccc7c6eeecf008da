"""The extended model as a separate Python module, which needs numpy and of scipy a solver."""

from __future__ import annotations

import sys
import textwrap
from collections.abc import Mapping, Sequence
from numbers import Integral

import numpy as np

from hybridsurrogate.arguments import check_units
from hybridsurrogate.diagnosis.fitting.result import DiagnosisResult
from hybridsurrogate.diagnosis.source.dynamics import dynamics
from hybridsurrogate.diagnosis.source.functions import extended_function, function_of
from hybridsurrogate.diagnosis.source.parts import (
    ExtendedModel,
    FittedCause,
    SourceParts,
    own_arguments,
)
from hybridsurrogate.diagnosis.source.text import LINE_WIDTH, inline
from hybridsurrogate.estimators.averaged import AveragedSurrogate, leading
from hybridsurrogate.model.posterior import Posterior
from hybridsurrogate.model.rows.stacking import Stacking
from hybridsurrogate.numerics.digits import listing, percent
from hybridsurrogate.ode.simulator import OdeSimulator
from hybridsurrogate.simulation.outputs import OUTPUT
from hybridsurrogate.simulation.simulator import Simulator
from hybridsurrogate.types import FloatArray


def docstring(model: ExtendedModel, parts: SourceParts) -> str:
    """Return the docstring, quotes included."""
    outputs = listing(list(model.outputs))
    causes = [one.cause for one in model.causes if one.cause.is_learned]
    found = [cause.name for cause in causes if cause.changes_output]
    what = f"extended by {listing(found)}" if found else "as it is, its parameters estimated"
    call = listing([*own_arguments(parts), *parts.columns.values()]) if parts.columns else ""
    noise = [part for part in parts.coded if part.code.does == "scatters"]
    text = [f"{outputs[:1].upper()}{outputs[1:]} of the simulation {model.name}, {what}."]
    text += list(model.about)
    others = [cause.name for cause in causes if not cause.changes_output]
    if others:
        text.append(f"Of the measurements, and not in the simulation: {listing(others)}.")
    text += [f"{p.function} is how measurements scatter around it." for p in noise]
    if parts.link:
        scale = "logarithm" if parts.link == "log" else "log odds"
        text.append(f"Causes act on the {scale} of the output.")
    text.append(f"The function extended takes {call}.")
    text.append(
        "Its defaults are posterior means, with 90 % intervals; in brackets are units, where a "
        "name stands for the unit of what it names."
    )
    lines = [line for each in text for line in [*textwrap.wrap(inline(each), LINE_WIDTH), ""]]
    if lines.index("") > 1:  # the first is no longer than a line
        lines = [f"An extension of {inline(model.name)[:60]}.", "", *lines]
    if parts.estimates:
        width = max(len(name) for name, _, _ in parts.estimates)
        table = [f"    {n:{width}}  {known} {unit}".rstrip() for n, known, unit in parts.estimates]
        lines += [*table, ""]
    if model.functions:
        given = [
            *(name for name, _ in model.functions),
            *own_arguments(parts)[len(model.functions) :],
        ]
        lines += [f"    from {module} import {name}" for name, module in model.functions]
        lines += ["", f"    extended({', '.join([*given, *parts.columns.values()])})", ""]
    lines += [*textwrap.wrap(inline(model.written_by), LINE_WIDTH), ""] if model.written_by else []
    return '"""' + "\n".join(lines[:-1]).rstrip('"') + '\n"""'


HELPERS = {
    "rows": '''def rows(*values):
    """Return values as arrays of floats of one shape."""
    values = np.broadcast_arrays(*(np.atleast_1d(value) for value in values))
    return [np.array(value, dtype=float) for value in values]''',
    "by_name": '''def by_name(values, axis=-1):
    """Return outputs by name, from a dict, a list or an array with outputs along an axis."""
    if isinstance(values, dict):
        return {name: values[name] for name in OUTPUTS}
    if not isinstance(values, tuple | list):
        values = np.moveaxis(np.asarray(values), axis, 0)
    return dict(zip(OUTPUTS, values, strict=True))''',
    "logistic": '''def logistic(x):
    """Return 1 / (1 + exp(-x)), which does not overflow here."""
    return (1 + np.tanh(x / 2)) / 2''',
    "each_row": '''def each_row(simulation, **values):
    """Run a simulation that takes numbers once for each row."""
    rows_of = zip(*(np.ravel(value).tolist() for value in values.values()), strict=True)
    return np.array([simulation(**dict(zip(values, own, strict=True))) for own in rows_of])''',
    "in_curves": '''def in_curves(simulation, **values):
    """Run a simulation that returns a curve over its first input, once for equal rows."""
    (name, places), *others = values.items()
    numbers = np.array([value for _, value in others]).reshape(len(others), len(places))
    output = [None] * len(places)
    for own in np.unique(numbers, axis=1).T:
        here = np.flatnonzero(np.all(numbers == own[:, None], axis=0))
        at, back = np.unique(places[here], return_inverse=True)
        given = {key: value for (key, _), value in zip(others, own, strict=True)}
        curve = np.asarray(simulation(**{name: at}, **given))
        for k, row in enumerate(here):
            output[row] = curve[..., back[k]]
    return np.moveaxis(np.array(output), 0, -1)''',
    "by_level": '''def by_level(values, table, other=0.0):
    """Return the number of each row's level, and a default for levels not in the table."""
    for level, number in table.items():
        other = np.where(values == level, number, other)
    return other''',
    "curve_of_level": '''def curve_of_level(values, by, levels, grid, curves):
    """Return the curve of each row's level at its value, zero for other levels."""
    out = np.zeros(np.shape(values))
    for level, curve in zip(levels, curves, strict=True):
        out = np.where(by == level, np.interp(values, grid, curve), out)
    return out''',
}


def extended_model(
    result: DiagnosisResult, units: Mapping[str, str] | None = None
) -> ExtendedModel:
    """Return what a module is written of, from all that a fit found.

    Parameters
    ----------
    result : DiagnosisResult
    units : mapping of name to str or None
        Of measured columns, outputs, parameters and states.

    Raises
    ------
    ValueError, TypeError
        For units of what there is not, or that are no text.
    """
    estimator, posterior = result.before, leading(result.extension.estimator).posterior_
    model, simulation = posterior.model, estimator.simulation
    simulator = simulation.simulator
    ode = simulator if isinstance(simulator, OdeSimulator) else None
    states = ode.states if ode is not None else ()
    names = [*model.columns, *simulation.outputs, *simulation.parameter_ranges, *states]
    sizes = tuple[float, ...]()
    if ode is not None:
        rows = estimator.measured_[0][:, : len(ode.input_names)]
        sizes = tuple(ode.typical_states(rows).values())
    return ExtendedModel(
        name=f"of {simulation.output}" if simulator is None else simulator.name,
        inputs=tuple(simulation.input_names),
        outputs=tuple(simulation.outputs),
        parameters=dict(zip(model.parameters, posterior.values.T, strict=False)),
        assumed={name: constant.value for name, constant in simulation.assumed.items()},
        causes=[
            FittedCause(cause, *posterior.draws_of(k)) for k, cause in enumerate(model.effects)
        ],
        likelihood=posterior.plain_likelihood,
        sigma=_sigma(posterior, simulation.outputs, estimator.data_.stacking),
        simulator=simulator,
        sizes=sizes,
        labels=estimator.data_.experiments.labels,
        units=check_units(units, [name for name in names if name != OUTPUT]),
        about=_about(result),
        written_by=_written_by(result),
        functions=_functions_of(simulator),
        returns_dict=_returns_dict(simulator, estimator.measured_[0], posterior),
    )


def _sigma(
    posterior: Posterior, outputs: Sequence[str], stacking: Stacking | None
) -> dict[str, FloatArray]:
    """Return draws of the noise of each output, in its unit."""
    if not posterior.plain_likelihood.has_scale:
        return {}
    scales = np.ones(1) if stacking is None else stacking.scale
    return {
        name: scale * posterior.noise_of(name, k)
        for k, (name, scale) in enumerate(zip(outputs, scales, strict=True))
    }


def _about(result: DiagnosisResult) -> list[str]:
    """Return the verdict and the detected causes."""
    right = result.conclusion.probability_right
    sure = "" if right is None else f" The name is right with a probability of {percent(right)}."
    text = [f"Verdict: {result.conclusion.verdict}.{sure}"]
    if result.conclusion.verdict == "ambiguous":
        alike = listing(list(result.indistinguishable))
        text.append(f"Causes that together have 90 % of the probability: {alike}.")
    for finding in result.extension.found_causes:
        if finding.kind != "none":
            text.append(f"{finding.kind}: {finding.formula}.")
    after = result.extension.estimator
    if isinstance(after, AveragedSurrogate) and len(after.estimators_) > 1:
        text.append(
            f"predict of the diagnosis averages over {len(after.estimators_)} explanations; this "
            "is the most probable one, without the remainder that may be lacking beyond the "
            "measured range."
        )
    return text


def _written_by(result: DiagnosisResult) -> str:
    from hybridsurrogate import __version__

    seeds = {"diagnosis": result.settings.random_state, "estimator": result.before.random_state}
    said = [
        f"random_state={seed if isinstance(seed, Integral) else 'not fixed'} of the {name}"
        for name, seed in seeds.items()
    ]
    return f"Written by hybridsurrogate {__version__}; {listing(said)}."


def _returns_dict(simulator: Simulator | None, X: FloatArray, posterior: Posterior) -> bool:
    """Return whether a function of arrays gives its one output in a dict: two rows are run."""
    quick = simulator is not None and simulator.vectorized and not simulator.is_in_time
    if simulator is None or not quick or len(simulator.outputs) > 1:
        return False
    means = posterior.values.mean(axis=0).tolist()
    values = {
        **dict(zip(simulator.input_names, X[0].tolist(), strict=False)),
        **dict(zip(posterior.model.parameters, means, strict=False)),
        **{name: constant.value for name, constant in simulator.assumed.items()},
    }
    try:
        with np.errstate(all="ignore"):
            output = simulator.function(**{name: np.full(2, v) for name, v in values.items()})
    except Exception:
        # it may fail in any way, and raises where it is run
        return False
    return isinstance(output, Mapping)


def _functions_of(simulator: Simulator | None) -> tuple[tuple[str, str], ...]:
    """Return names and modules of what is passed, nothing where some cannot be imported."""
    if simulator is None:
        return ()
    functions = [simulator.function]
    if isinstance(simulator, OdeSimulator):
        start = [simulator.initial_state] if callable(simulator.initial_state) else []
        functions = [simulator.rhs, *start, simulator.observe]
    found = [(getattr(f, "__name__", ""), getattr(f, "__module__", "")) for f in functions]
    for function, (name, module) in zip(functions, found, strict=True):
        if module == "__main__" or getattr(sys.modules.get(module), name, None) is not function:
            return ()
    return tuple(found)


def python_source(model: ExtendedModel) -> str:
    """Return the source of a module with the extended model."""
    parts = SourceParts(model)
    head = [docstring(model, parts), "import numpy as np"]
    written = [part for part in parts.coded if part.code.does != "delays"]
    functions = [function_of(part, parts) for part in written]
    body = dynamics(model, parts) if parts.ode is not None else []
    body.append(extended_function(model, parts))
    text = "\n\n\n".join([*functions, *body])
    helpers = [HELPERS[name] for name in HELPERS if f"{name}(" in text]
    if "solve_ivp(" in text:
        head.append("from scipy.integrate import solve_ivp")
    if "RectBivariateSpline(" in text:
        head.append("from scipy.interpolate import RectBivariateSpline")
    start = "\n".join([head[0], "", *head[1:], "", *parts.constants])
    return "\n\n\n".join([start, *helpers, text]) + "\n"
