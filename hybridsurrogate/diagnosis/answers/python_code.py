"""The extended model as a Python module of its own, which needs numpy and of scipy a solver."""

from __future__ import annotations

import json
import keyword
import math
import re
import sys
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from numbers import Integral
from typing import Any

import numpy as np

from hybridsurrogate.arguments.description import described
from hybridsurrogate.digits import interval, listing, percent
from hybridsurrogate.effects.base import Cause, Rows
from hybridsurrogate.effects.code import Code, Table
from hybridsurrogate.effects.dynamics.dynamic_delay import DynamicDelay
from hybridsurrogate.effects.dynamics.dynamic_drift import DynamicDrift
from hybridsurrogate.effects.dynamics.dynamic_term import DynamicTerm
from hybridsurrogate.effects.in_output import InOutput
from hybridsurrogate.effects.noise.output_noise import OutputNoise
from hybridsurrogate.effects.notation import digits_at
from hybridsurrogate.estimators.averaged import AveragedSurrogate, leading
from hybridsurrogate.exceptions import did_you_mean
from hybridsurrogate.likelihoods import Binomial, Likelihood, Normal
from hybridsurrogate.ode.dynamics import DelayedState, MissingTerm, TimeVaryingParameter
from hybridsurrogate.ode.simulator import OdeSimulator
from hybridsurrogate.posterior import Posterior
from hybridsurrogate.priors import FloatArray
from hybridsurrogate.problem.stacking import Stacking
from hybridsurrogate.simulation.modification import Modification
from hybridsurrogate.simulation.outputs import OUTPUT
from hybridsurrogate.simulation.simulator import Simulator

WIDTH = 88
# digits of a default beyond those of its interval: rounding is no part of the error
_DIGITS = 6
# methods of the module by those of the simulator; others are scipy's own
_METHODS = {"rk4": "DOP853", "rosenbrock": "Radau"}
# steps that a solver takes at least, so that no sudden change is stepped over
_LEAST_STEPS = 100
_INSIDE = ("scales rate", "adds to slope", "delays")
# what rewrites the measured rows: a subclass that overrides one of these has no code any more
_REWRITES = ("inputs", "gain", "response", "columns", "factors", "noise", "estimates")
_RESERVED = re.findall(
    r"\w+",
    "np solve_ivp RectBivariateSpline float dict zip list len isinstance min max enumerate tuple "
    "simulation simulated output outputs rhs initial_state observe state states slopes seen "
    "extended rows by_level by_name each_row in_curves curve_of_level right_hand_side solutions "
    "solution START STEP OUTPUTS STATES SIZES FIRST I l O sigma numbers columns times first "
    "derivative solved ends latest ago which moment piece late longest lags",
)


@dataclass(frozen=True)
class FittedCause:
    """A prepared cause, and draws of its own parameters and coefficients, (n_draws,) each."""

    cause: Cause
    theta: Rows
    coefficients: Rows


@dataclass(frozen=True)
class ExtendedModel:
    """What a module is written of.

    Attributes
    ----------
    name : str
        Of the simulation.
    functions : tuple of (str, str)
        Names and modules of the functions that are passed, where they can be imported: the
        simulation, or ``rhs``, ``initial_state`` where it is a function, and ``observe``.
    inputs, outputs : tuple of str
    parameters : dict of name to ndarray of shape (n_draws,)
    assumed : dict of name to float
    causes : sequence of FittedCause
    likelihood : Likelihood
    sigma : dict of output to ndarray of shape (n_draws,)
        Standard deviation of the noise, empty where there is none.
    simulator : Simulator or None
    sizes : tuple of float
        Typical sizes of the states of an `OdeSimulator`.
    labels : dict of column to tuple of str
        Names of experiments that a column numbers.
    units : dict of name to str
    about : sequence of str
        Paragraphs of the docstring.
    """

    name: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    parameters: Mapping[str, FloatArray]
    assumed: Mapping[str, float]
    causes: Sequence[FittedCause]
    likelihood: Likelihood
    sigma: Mapping[str, FloatArray] = field(default_factory=dict)
    simulator: Simulator | None = None
    sizes: tuple[float, ...] = ()
    labels: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    about: Sequence[str] = ()
    functions: tuple[tuple[str, str], ...] = ()


def extended_model(diagnosis: Any, units: Mapping[str, str] | None = None) -> ExtendedModel:
    """Return what a module is written of, from a fitted diagnosis.

    Parameters
    ----------
    diagnosis : DiscrepancyDiagnosis
    units : mapping of name to str or None
        Of measured columns, outputs, parameters and states.

    Raises
    ------
    ValueError, TypeError
        For units of what there is not, or that are no text.
    """
    estimator, posterior = diagnosis.estimator_, leading(diagnosis.extended_estimator_).posterior_
    model, simulation = posterior.model, estimator.simulation
    simulator = simulation.simulator
    ode = simulator if isinstance(simulator, OdeSimulator) else None
    states = ode.states if ode is not None else ()
    names = [*model.columns, *simulation.outputs, *simulation.parameter_ranges, *states]
    experiments, sizes = estimator.experiments_, tuple[float, ...]()
    if ode is not None:
        rows = estimator.measured_[0][:, : len(ode.input_names)]
        sizes = tuple(ode.typical_states(rows).values())
    labels = {}
    if experiments is not None and experiments.labels is not None:
        labels = {experiments.column: experiments.labels}
    return ExtendedModel(
        name=simulation.name if simulator is None else simulator.name,
        inputs=tuple(simulation.input_names),
        outputs=tuple(simulation.outputs),
        parameters=dict(zip(model.parameters, posterior.values.T, strict=False)),
        assumed={name: constant.value for name, constant in simulation.assumed.items()},
        causes=[
            FittedCause(cause, *posterior.draws_of(k)) for k, cause in enumerate(model.effects)
        ],
        likelihood=posterior.plain_likelihood,
        sigma=_sigma(posterior, simulation.outputs, estimator.stacking_),
        simulator=simulator,
        sizes=sizes,
        labels=labels,
        units=_checked_units(units, [name for name in names if name != OUTPUT]),
        about=_about(diagnosis),
        functions=_functions_of(simulator),
    )


def _sigma(
    posterior: Posterior, outputs: Sequence[str], stacking: Stacking | None
) -> dict[str, FloatArray]:
    """Return draws of the noise of each output, in its unit."""
    if not posterior.plain_likelihood.has_scale:
        return {}
    if stacking is None:
        return {outputs[0]: posterior.sigma}
    effects = posterior.model.effects
    ratios = [k for k, effect in enumerate(effects) if isinstance(effect, OutputNoise)]
    known = posterior.estimates(ratios[0]) if ratios else {}
    return {
        name: scale * known.get(f"noise of {name}", 1.0) * posterior.sigma
        for name, scale in zip(outputs, stacking.scale, strict=True)
    }


def _checked_units(units: Mapping[str, str] | None, names: Sequence[str]) -> dict[str, str]:
    if units is None:
        return {}
    if not isinstance(units, Mapping):
        raise TypeError(f'units must be a dict such as {{"co2": "ppm"}}, got {described(units)}.')
    for name, unit in units.items():
        if name not in names:
            raise ValueError(
                f"units: there is no {name!r}; there are {', '.join(names)}."
                f"{did_you_mean(str(name), names)}"
            )
        if not isinstance(unit, str):
            raise TypeError(f"The unit of {name!r} must be text, got {described(unit)}.")
    return dict(units)


def _about(diagnosis: Any) -> list[str]:
    """Return the verdict, what was found, and how."""
    from hybridsurrogate import __version__

    right = diagnosis.probability_right_
    sure = "" if right is None else f" The name is right with a probability of {percent(right)}."
    text = [f"Verdict: {diagnosis.verdict_}.{sure}"]
    for finding in diagnosis.found_causes_:
        if finding.kind != "none":
            text.append(f"{finding.kind}: {finding.formula}.")
    after = diagnosis.extended_estimator_
    if isinstance(after, AveragedSurrogate) and len(after.estimators_) > 1:
        text.append(
            f"predict of the diagnosis averages over {len(after.estimators_)} explanations; this "
            "is the most probable one, and says nothing of what may be lacking beyond the "
            "measured range."
        )
    seeds = {"diagnosis": diagnosis.random_state, "estimator": diagnosis.estimator.random_state}
    said = [
        f"random_state={seed if isinstance(seed, Integral) else 'not fixed'} of the {name}"
        for name, seed in seeds.items()
    ]
    return [*text, f"Written by hybridsurrogate {__version__}; {listing(said)}."]


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
    """Return the source of a module that holds the extended model."""
    parts = _Parts(model)
    head = [_docstring(model, parts), "import numpy as np"]
    written = [part for part in parts.coded if part.code.does != "delays"]
    functions = [_function(part, model) for part in written]
    body = _ode(model, parts) if parts.ode is not None else []
    body.append(_extended(model, parts))
    text = "\n\n\n".join([*functions, *body])
    helpers = [_HELPERS[name] for name in _HELPERS if f"{name}(" in text]
    if "RectBivariateSpline(" in text:
        head.append("from scipy.interpolate import RectBivariateSpline")
    if "solve_ivp(" in text:
        head.append("from scipy.integrate import solve_ivp")
    start = "\n".join([head[0], "", *head[1:], "", *parts.constants])
    return "\n\n\n".join([start, *helpers, text]) + "\n"


# -------------------------------------------------------------------------------------- names


class _Names:
    """Identifiers for any names, each once."""

    def __init__(self, taken: Iterable[str]):
        self.taken = set(taken)

    def new(self, text: str) -> str:
        """Return an identifier that is like a text, and none that is taken."""
        name = re.sub(r"\W", "_", text).strip() or "x"
        name = name if name.strip("_") else "x" + name
        name = f"x{name}" if not name.isidentifier() else name
        if keyword.iskeyword(name) or name in self.taken:
            name = next(
                free
                for k in range(1, len(self.taken) + 3)
                if (free := f"{name}_{k if k > 1 else ''}") not in self.taken
            )
        self.taken.add(name)
        return name

    def local(self, text: str) -> str:
        """Return an identifier that is none of those taken, for one function alone."""
        name = self.new(text)
        self.taken.remove(name)
        return name


@dataclass(frozen=True)
class _Part:
    """The code of a cause, and what its names in braces are in the module."""

    cause: Cause
    code: Code
    function: str
    ids: Mapping[str, str]
    # arguments of `extended`, and what their defaults are
    numbers: Mapping[str, str]

    @property
    def inside(self) -> dict[str, str]:
        """What names in braces are in the cause's function, in which numbers are called shortly."""
        code = self.code
        others = {name for key, name in self.ids.items() if key not in code.numbers}
        return {
            **self.ids,
            **{k: k for k in code.numbers if k not in others and k not in _RESERVED},
        }


class _Parts:
    """All names and numbers of a module."""

    def __init__(self, model: ExtendedModel):
        self.model = model
        self.names = _Names(_RESERVED)
        self.constants: list[str] = []
        simulator = model.simulator
        if len(model.outputs) > 1:
            self.constants.append(f"OUTPUTS = {_tuple(model.outputs)}")
        self.ode = simulator if isinstance(simulator, OdeSimulator) else None
        self.link, self.word = _link(model.likelihood)
        causes = [one for one in model.causes if one.cause.is_learned]
        codes = [_code_of(one.cause) for one in causes]
        read = [c for code in codes if code for c in code.columns.values()]
        own = [one.cause for one, code in zip(causes, codes, strict=True) if code is None]
        read += [column for cause in own for column in cause.reads]
        known = [*model.inputs, *model.parameters, *model.assumed]
        self.columns = {
            name: self.names.new(name)
            for name in dict.fromkeys([*model.inputs, *(c for c in read if c not in known)])
        }
        self.parameters = {
            name: self.names.new(name) for name in (*model.parameters, *model.assumed)
        }
        self.ids = {**self.columns, **self.parameters}
        self._replaced = {
            code.of: self._draws(one)["value"]
            for one, code in zip(causes, codes, strict=True)
            if code is not None and code.does == "replaces"
        }
        self._constant_of_parameters()
        self.coded: list[_Part] = []
        self.own: list[tuple[FittedCause, str, dict[str, str]]] = []
        self._of_simulator()
        for one, code in zip(causes, codes, strict=True):
            if code is None:
                self.own.append(self._own(one))
            elif code.does not in ("replaces", "nothing"):
                self.coded.append(self._part(one, code))

    def defaults(self) -> dict[str, str]:
        """Return the arguments of `extended` after the columns, with their defaults."""
        out = {self.parameters[name]: self._defaults[name] for name in self.parameters}
        for part in self.coded:
            if part.code.does != "scatters":
                out |= part.numbers
        for _, _, numbers in self.own:
            out |= numbers
        return out

    def unit(self, template: str, code: Code | None = None) -> str:
        """Return a unit of which the names stand in braces."""
        model = self.model
        output = (code and code.output) or (model.outputs[0] if len(model.outputs) == 1 else "y")
        plain = model.units.get(output, output)
        known = {"plain": plain, "y": f"{self.word}{plain}"}
        known["t"] = model.units.get(model.inputs[0], model.inputs[0]) if model.inputs else "t"
        if code is not None:
            own = {**code.columns, **code.states, "of": code.of}
            known |= {key: model.units.get(name, name) for key, name in own.items()}
            known.setdefault("state", model.units.get(code.of, code.of))
        return _inline(template.format_map(known))

    def _draws(self, one: FittedCause) -> dict[str, FloatArray]:
        told = one.cause.estimates(one.theta, one.coefficients)
        return {**one.theta, **one.coefficients, **told}

    def _constant_of_parameters(self) -> None:
        model, self._defaults = self.model, {}
        if self.parameters:
            self.constants.append("# parameters of the simulation")
        for name in self.parameters:
            draws = self._replaced.get(name, model.parameters.get(name))
            note, unit = "", model.units.get(name, "")
            if name in model.assumed:
                note = "assumed"
                if draws is not None:
                    note = f"was assumed to be {model.assumed[name]:.6g}"
                else:
                    draws = np.array([model.assumed[name]])
            elif name in self._replaced:
                note = "outside its prior"
            assert draws is not None
            self._defaults[name] = self._constant(self.parameters[name], draws, unit, note)

    def _constant(self, name: str, draws: FloatArray, unit: str = "", note: str = "") -> str:
        """Write the mean of draws under a name in capitals, and return that."""
        constant = self.names.new(name.upper())
        value, known = _estimate(draws)
        unit = f"[{_inline(unit)}]" if unit not in ("", "1") else ""
        words = " ".join(filter(None, [known, note, unit]))
        self.constants.append(f"{constant} = {value}" + (f"  # {words}" if words else ""))
        return constant

    def _heading(self, cause: Cause) -> None:
        self.constants.append(f"# {_inline(cause.name)}")

    def _of_simulator(self) -> None:
        """Take in changes of the dynamics that the simulation had before."""
        for change in self.ode.modifications if self.ode is not None else ():
            names = {name: change.full(name) for name in change.neutral}
            if not all(full in self.ids for full in names.values()):
                continue  # at numbers that change nothing
            cause = _as_cause(change)
            code = cause.code()
            assert code is not None
            ids = {name: self.ids[full] for name, full in names.items()}
            function = self._function(cause, cause.kind, names)
            self.coded.append(self._coded(cause, code, function, ids, {}))

    def _function(self, cause: Cause, wanted: str, numbers: Iterable[str]) -> str:
        """Return a name for a cause's function that none of its numbers has."""
        inner = cause.cause if isinstance(cause, InOutput) else cause
        plain = re.sub(r"\W", "_", wanted)
        if plain in numbers:
            plain = f"{plain}_effect"
        free = f"{plain}_{inner.target}" if plain in self.names.taken and inner.target else plain
        return self.names.new(free)

    def _number(self, function: str, name: str) -> str:
        return self.names.new(f"{function}_{name}" if name in self.names.taken else name)

    def _own(self, one: FittedCause) -> tuple[FittedCause, str, dict[str, str]]:
        if isinstance(one.cause, InOutput):
            raise ValueError(
                f"The cause {one.cause.name!r} is not written as Python: give its class a method "
                "code() that returns a Code, as those of the catalogue have."
            )
        numbers: dict[str, str] = {}
        self._heading(one.cause)
        own = {**one.theta, **one.coefficients}
        function = self._function(one.cause, one.cause.kind, own)
        for name, draws in own.items():
            argument = self._number(function, name)
            numbers[argument] = self._constant(argument, draws)
        return one, function, numbers

    def _part(self, one: FittedCause, code: Code) -> _Part:
        draws = self._draws(one)
        ids: dict[str, str] = {}
        numbers: dict[str, str] = {}
        self._heading(one.cause)
        function = self._function(one.cause, code.name or one.cause.kind, code.numbers)
        for name, unit in code.numbers.items():
            ids[name] = self._number(function, name)
            numbers[ids[name]] = self._constant(ids[name], draws[name], self.unit(unit, code))
        if code.table is not None:
            ids["table"] = self.names.new(f"by_{code.table.column}")
            numbers[ids["table"]] = self._table(code.table, code, ids["table"], draws)
        if code.tables is not None:
            for name, values in code.tables(one.theta, one.coefficients).items():
                ids[name] = self.names.new(name.upper())
                self.constants += _array(ids[name], values)
        if "{sigma}" in code.expression:
            sigma = self.model.sigma.get(code.output or self.model.outputs[0], np.ones(1))
            numbers["sigma"] = self._constant("noise_sd", sigma, self.unit("{y}", code))
        return self._coded(one.cause, code, function, ids, numbers)

    def _table(self, table: Table, code: Code, name: str, draws: Rows) -> str:
        constant = self.names.new(name.upper())
        unit = self.unit(table.unit, code)
        lines = [f"{constant} = {{" + (f"  # [{unit}]" if unit != "1" else "")]
        for level, number in table.levels:
            value, known = _estimate(draws[number])
            note = f"  # {known}" if known else ""
            lines.append(f"    {self.level(table.column, level)}: {value},{note}")
        self.constants += [*lines, "}"]
        return constant

    def level(self, column: str, value: float) -> str:
        """Return a value of a column of labels as a literal."""
        labels = self.model.labels.get(column)
        return _literal(labels[int(value)]) if labels else _text(value)

    def _coded(
        self,
        cause: Cause,
        code: Code,
        function: str,
        ids: Mapping[str, str],
        numbers: Mapping[str, str],
    ) -> _Part:
        every = {"simulated": "simulated", "sigma": "sigma", **ids}
        every |= {key: self.ids[column] for key, column in code.columns.items()}
        if code.of in self.ids:
            every["of"] = self.ids[code.of]
        if self.ode is not None:
            every["t"] = self.ids[self.ode.input_names[0]]
        every |= {key: self.level(*where) for key, where in code.levels.items()}
        for key in (*code.constants, *code.steps, *code.grids, *code.arguments, "step"):
            every[key] = self.names.local(key)
        states = {name: self.names.local(name) for name in dict.fromkeys(code.states.values())}
        every |= {key: states[name] for key, name in code.states.items()}
        every |= {name: self.names.new(name) for name in code.by_row}
        return _Part(cause, code, function, every, dict(numbers))


def _code_of(cause: Cause) -> Code | None:
    """Return the code of a cause; None for a user's, and where a subclass does something else."""
    inner = cause.cause if isinstance(cause, InOutput) else cause
    order = type(inner).__mro__
    places = {
        name: next(k for k, one in enumerate(order) if name in vars(one))
        for name in ("code", *_REWRITES)
    }
    if any(places[name] < places["code"] for name in _REWRITES):
        return None
    return cause.code()


def _as_cause(change: Modification) -> Cause:
    """Return the cause that makes a change of the dynamics."""
    if isinstance(change, TimeVaryingParameter):
        return DynamicDrift(change.parameter, change.shape, center=change.center)
    if isinstance(change, MissingTerm):
        return DynamicTerm(
            change.state, change.form, center=change.center, size=change.size, other=change.other
        )
    if isinstance(change, DelayedState):
        return DynamicDelay(change.state)
    raise ValueError(
        f"The simulation has a change of its dynamics that is not written as Python: {change!r}."
    )


# ------------------------------------------------------------------------------------ numbers


def _text(value: float) -> str:
    value = float(value)
    if not math.isfinite(value):
        return "np.nan" if math.isnan(value) else "np.inf" if value > 0 else "-np.inf"
    return repr(value)


def _literal(text: str) -> str:
    """Return a string as source, in double quotes."""
    return json.dumps(text)


def _tuple(texts: Sequence[str]) -> str:
    """Return strings as a tuple in source."""
    return f"({', '.join(map(_literal, texts))}{',' if len(texts) == 1 else ''})"


def _estimate(draws: FloatArray) -> tuple[str, str]:
    """Return the mean of draws as a literal, and their 90 % interval in words."""
    draws = np.ravel(np.asarray(draws, dtype=float))
    mean = float(draws.mean())
    low, high = (float(end) for end in np.quantile(draws, [0.05, 0.95]))
    if not high > low:
        return _text(mean), ""
    digits = min(digits_at(mean, high - low, _DIGITS), 17)
    ends = re.search(r"\((.*)\)", interval(mean, low, high))
    return _text(float(f"{mean:.{digits}g}")), f"90 %: {ends.group(1)}" if ends else ""


def _array(name: str, values: FloatArray) -> list[str]:
    """Return an array of numbers with six digits."""
    wrapped = []
    for row in np.atleast_2d(values):
        text = ", ".join(repr(float(f"{value:.6g}")) for value in row)
        lines = textwrap.wrap(text, WIDTH - 8)
        wrapped += [f"    [{lines[0]}", *(f"     {line}" for line in lines[1:])]
        wrapped[-1] += "],"
    flat = [] if np.ndim(values) == 2 else [""]
    end = "])[0]" if flat else "])"
    return ["# fmt: off", f"{name} = np.array([", *wrapped, end, "# fmt: on"]


def _link(likelihood: Likelihood) -> tuple[str, str]:
    """Return the scale on which causes act, and a word for it."""
    plain = likelihood
    while hasattr(plain, "plain"):
        plain = plain.plain
    if isinstance(plain, Binomial):
        return f"logit {plain.trials}", "log odds of "
    if plain.log_scale:
        return "log", "log "
    if type(plain).link not in (Likelihood.link, Normal.link):
        raise ValueError(
            f"The likelihood {plain.name!r} has a link of its own, which is not written as Python."
        )
    return "", ""


# -------------------------------------------------------------------------------------- words


def _inline(text: str) -> str:
    """Return any text as part of a comment or of a docstring: one line, and no end of it."""
    plain = "".join(c if c.isprintable() else " " for c in text)
    return plain.replace("\\", "/").replace('"""', "'''").strip()


def _docstring(model: ExtendedModel, parts: _Parts) -> str:
    outputs = listing(list(model.outputs))
    found = [one.cause.name for one in model.causes if one.cause.is_learned]
    what = f"extended by {listing(found)}" if found else "as it is, its parameters estimated"
    call = listing([*_own_arguments(parts), *parts.columns.values()]) if parts.columns else ""
    noise = [part for part in parts.coded if part.code.does == "scatters"]
    text = [f"{outputs[:1].upper()}{outputs[1:]} of the simulation {model.name}, {what}."]
    text += list(model.about)
    if model.causes and not any(one.cause.changes_output for one in model.causes):
        text.append("The simulation is as it was; only its parameters were estimated anew.")
    text += [f"{p.function} is how measurements scatter around it." for p in noise]
    if parts.link:
        scale = "logarithm" if parts.link == "log" else "log odds"
        text.append(f"Causes act on the {scale} of the output.")
    text.append(
        "Numbers are posterior means, with 90 % intervals; in brackets are units, where a name "
        "stands for the unit of what it names."
    )
    text.append(f"The function extended takes {call}.")
    lines = [line for each in text for line in [*textwrap.wrap(_inline(each), WIDTH), ""]]
    if model.functions:
        given = [
            *(name for name, _ in model.functions),
            *_own_arguments(parts)[len(model.functions) :],
        ]
        lines += [f"    from {module} import {name}" for name, module in model.functions]
        lines += ["", f"    extended({', '.join([*given, *parts.columns.values()])})", ""]
    return '"""' + "\n".join(_first_alone(lines, model.name)[:-1]).rstrip('"') + '\n"""'


def _first_alone(lines: list[str], name: str) -> list[str]:
    """Return lines of a docstring of which the first is no longer than a line."""
    return lines if lines.index("") == 1 else [f"An extension of {_inline(name)[:60]}.", "", *lines]


def _does(part: _Part, model: ExtendedModel) -> str:
    code, word = part.code, _link(model.likelihood)[1]
    output = code.output or listing(list(model.outputs))
    said = {
        "adds": f"Return what is added to {word}{output}: {part.cause.name}.",
        "responds": f"Return what becomes of {word}{output}: {part.cause.name}.",
        "moves": f"Return {code.of} as the simulation is run with: {part.cause.name}.",
        "scales rate": f"Return the factor on {code.of} at a time.",
        "adds to slope": f"Return what is added to the slope of {code.of}.",
        "delays": f"Return how long ago the slopes see {code.of}.",
    }
    noises = {
        "noise_sd": f"Return the standard deviation of the noise of {word}{output}.",
        "noise_covariance": f"Return the covariance of correlated noise of {word}{output}.",
        "noise_variance": f"Return the variance of counts of {output}.",
        "noise_draws": f"Return draws of the noise of {word}{output}.",
    }
    text = _inline(said.get(code.does) or noises[code.name])
    # a name that is too long stands in the docstring of the module
    return text if len(text) <= WIDTH - 10 else f"{text.partition(': ')[0].rstrip('.')}."


# ---------------------------------------------------------------------------------- functions


def _definition(name: str, arguments: Sequence[str]) -> str:
    line = f"def {name}({', '.join(arguments)}):"
    if len(line) <= WIDTH:
        return line
    return "\n".join([f"def {name}(", *(f"    {one}," for one in arguments), "):"])


def _call(name: str, arguments: Sequence[str], before: str = "", indent: int = 4) -> str:
    """Return a line that calls a function, over several lines where it is long."""
    space = " " * indent
    line = f"{space}{before}{name}({', '.join(arguments)})"
    if len(line) <= WIDTH:
        return line
    inside = f"{space}    {', '.join(arguments)}"
    if len(inside) <= WIDTH and not any(one.startswith("*") for one in arguments):
        return "\n".join([f"{space}{before}{name}(", inside, f"{space})"])
    return "\n".join(
        [f"{space}{before}{name}(", *(f"{space}    {one}," for one in arguments), f"{space})"]
    )


def _arguments_of(part: _Part) -> list[str]:
    """Return the names of a cause's function's arguments without a default."""
    code, ids = part.code, part.ids
    used = _placeholders(code)
    keys = [*(["simulated"] if "simulated" in used else []), *(["of"] if "of" in used else [])]
    keys += [key for key in code.columns if key in used]
    keys += [key for key in code.states if key in used]
    keys += [*(["t"] if "t" in used else []), *code.arguments, *code.by_row]
    return list(dict.fromkeys(ids[key] for key in keys))


def _placeholders(code: Code) -> set[str]:
    texts = [code.expression, *code.steps.values()]
    return {name for text in texts for name in re.findall(r"(?<!\{)\{(\w+)\}", text)}


def _numbers_of(part: _Part) -> list[str]:
    """Return the cause's numbers as its function takes them, its table last."""
    used = {part.ids[key] for key in _placeholders(part.code)}
    own = [part.ids[key] for key in part.code.numbers] + list(part.numbers)
    return [name for name in dict.fromkeys(own) if name in used]


def _function(part: _Part, model: ExtendedModel) -> str:
    code, ids = part.code, part.inside
    short = {part.ids[key]: ids[key] for key in part.ids}
    arguments = _arguments_of(part)
    arguments += [
        f"{short.get(name, name)}={part.numbers[name]}" if name in part.numbers else short[name]
        for name in _numbers_of(part)
    ]
    lines = [_definition(part.function, arguments), f'    """{_does(part, model)}"""']
    used = _placeholders(code)
    for key, value in code.constants.items():
        lines.append(f"    {ids[key]} = {_text(value)}")
    for key, (low, high, n) in code.grids.items():
        lines.append(f"    {ids[key]} = np.linspace({_text(low)}, {_text(high)}, {n})")
    if "step" in used and isinstance(model.simulator, OdeSimulator):
        lines.append(f"    {ids['step']} = {_text(model.simulator.function.step)}")
    for key, text in code.steps.items():
        lines.append(f"    {ids[key]} = {text.format_map(ids)}")
    lines.append(f"    return {code.expression.format_map(ids)}")
    return "\n".join(lines)


def _keywords(names: Iterable[str], ids: Mapping[str, str]) -> list[str]:
    """Return arguments by name, those with names that are no identifiers in a dict."""
    names = list(names)
    plain = [n for n in names if n.isidentifier() and not keyword.iskeyword(n)]
    others = [f"{_literal(n)}: {ids[n]}" for n in names if n not in plain]
    return [
        *(f"{n}={ids[n]}" for n in plain),
        *([f"**{{{', '.join(others)}}}"] if others else []),
    ]


def _own_arguments(parts: _Parts) -> list[str]:
    own = ["simulation"]
    if parts.ode is not None:
        start = ["initial_state"] if callable(parts.ode.initial_state) else []
        own = ["rhs", *start, "observe"]
    return [*own, *(name for _, name, _ in parts.own)]


def _extended(model: ExtendedModel, parts: _Parts) -> str:
    defaults = parts.defaults()
    arguments = [*_own_arguments(parts), *parts.columns.values()]
    arguments += [f"{name}={default}" for name, default in defaults.items()]
    outputs = _inline(listing(list(model.outputs)))
    lines = [_definition("extended", arguments)]
    lines += [f'    """Return {outputs} of the extended simulation.', ""]
    lines += [*_explained(model, parts), '    """']
    labelled = [parts.columns[c] for c in model.labels if c in parts.columns]
    numeric = [c for c in parts.columns.values() if c not in labelled]
    numeric += list(parts.parameters.values())
    lines.append(_call("rows", numeric, f"{', '.join(numeric)} = " if len(numeric) > 1 else ""))
    if len(numeric) == 1:
        lines[-1] = f"    ({numeric[0]},) = rows({numeric[0]})"
    lines += [f"    {name} = np.asarray({name})" for name in labelled]
    now = dict(parts.ids)
    lines += _moves(parts, now)
    lines += _run(model, parts, now)
    lines += _changes(model, parts)
    return "\n".join(lines)


def _explained(model: ExtendedModel, parts: _Parts) -> list[str]:
    units = {c: f" [{model.units[c]}]" for c in parts.columns if c in model.units}
    columns = listing([f"{n}{units.get(c, '')}" for c, n in parts.columns.items()])
    names = list(dict.fromkeys([*model.inputs, *model.parameters, *model.assumed]))
    of = listing([_inline(name) for name in names])
    text = [f"simulation: your function {model.name} of {of}, by name; arrays in, an array out."]
    if parts.ode is not None:
        states = listing(list(parts.ode.states))
        text = [f"rhs, observe: those of your OdeSimulator, of the states {states}."]
    if len(model.outputs) > 1:
        text.append(f"Returns a dict of {listing(list(model.outputs))}.")
    text += [
        f"{name}: your cause, an instance of {type(one.cause).__name__}."
        for one, name, _ in parts.own
    ]
    text.append(f"Measured columns: {columns}. All else has its estimate as default.")
    return [f"    {line}" for each in text for line in textwrap.wrap(_inline(each), WIDTH - 4)]


def _moves(parts: _Parts, now: dict[str, str]) -> list[str]:
    """Return lines that move columns and parameters; what stands for them comes into `now`."""
    lines = []
    for part in parts.coded:
        for key, text in part.code.by_row.items():
            lines.append(f"    {part.ids[key]} = {text.format_map(part.ids)}")
        if part.code.does != "moves":
            continue
        of = part.code.of
        current = {parts.ids[name]: now[name] for name in parts.ids}
        given = [current.get(one, one) for one in (*_arguments_of(part), *_numbers_of(part))]
        if of in parts.columns and now[of] == parts.ids[of]:
            # what is added looks at the column as it was measured
            now[of] = parts.names.new(f"run_{parts.ids[of]}")
        lines.append(_call(part.function, given, f"{now[of]} = "))
    for one, name, numbers in parts.own:
        if one.cause.moves_inputs:
            lines += _moves_of_own(parts, now, name, one, numbers)
    return lines


def _moves_of_own(
    parts: _Parts, now: dict[str, str], name: str, one: FittedCause, numbers: Mapping[str, str]
) -> list[str]:
    columns, points = (
        _dict({key: now[key] for key in keys}) for keys in (parts.columns, parts.parameters)
    )
    lines = [f"    columns, numbers = {name}.inputs({columns}, {points}, {_theta(one, numbers)})"]
    for key in parts.columns:
        if now[key] == parts.ids[key]:
            now[key] = parts.names.new(f"run_{parts.ids[key]}")
        lines.append(f"    {now[key]} = columns[{_literal(key)}]")
    return lines + [f"    {now[key]} = numbers[{_literal(key)}]" for key in parts.parameters]


def _dict(values: Mapping[str, str]) -> str:
    """Return a dict of names and of what stands for them."""
    return f"{{{', '.join(f'{_literal(key)}: {value}' for key, value in values.items())}}}"


def _theta(one: FittedCause, numbers: Mapping[str, str]) -> str:
    """Return a user's cause's own parameters as a dict."""
    return _dict(dict(zip(one.theta, numbers, strict=False)))


def _run(model: ExtendedModel, parts: _Parts, now: Mapping[str, str]) -> list[str]:
    """Return lines that run the simulation."""
    several = len(model.outputs) > 1
    result = "outputs = by_name" if several else "output = "
    if parts.ode is not None:
        ode, time = parts.ode.function, now[parts.ode.input_names[0]]
        lines = [f"    {time} = np.maximum({time}, START)"]
        start = ["initial_state"] if callable(ode.initial_state) else []
        solved = ["rhs", *start, time, *(now.get(n, n) for n in _varying(parts))]
        lines.append(_call("solutions", solved, "states = "))
        seen = ["states", *_keywords(ode.observe_names, now)]
        if several:
            lines.append(_call("observe", seen, "output = "))
            return [*lines, "    outputs = by_name(output, axis=0)"]
        return [*lines, _call("observe", seen, result)]
    names = [*model.inputs, *model.parameters, *model.assumed]
    given = _keywords(names, now)
    simulator = model.simulator
    way = ""
    if simulator is not None and not simulator.vectorized:
        way = "in_curves" if simulator.returns == "curve" else "each_row"
    if not way:
        lines = [_call("simulation", given, "output = ")]
    elif several:
        one = "lambda **own: [*by_name(simulation(**own)).values()]"
        lines = [_call(way, [one, *given], "output = ")]
    else:
        lines = [_call(way, ["simulation", *given], "output = ")]
    if several:
        lines.append(
            "    outputs = by_name(output)"
            if way != "in_curves"
            else "    outputs = by_name([*output])"
        )
    return lines


def _changes(model: ExtendedModel, parts: _Parts) -> list[str]:
    """Return lines that make of the simulated output the extended one."""
    outer = [p for p in parts.coded if p.code.does in ("responds", "adds")]
    several = len(model.outputs) > 1
    lines = []
    for name in model.outputs:
        own = [p for p in outer if p.code.output in (None, name)]
        var = f"outputs[{_literal(name)}]" if several else "output"
        if own or parts.own:
            into, back = _scale(parts.link, var)
            changed = [line for part in own for line in _changed(part, var, "responds")]
            changed += [line for one in parts.own for line in _changed_by_own(parts, one, var)]
            changed += [line for part in own for line in _changed(part, var, "adds")]
            lines += [*into, *changed, *back]
    return [*lines, f"    return {'outputs' if several else 'output'}"]


def _scale(link: str, var: str) -> tuple[list[str], list[str]]:
    """Return lines that bring an output to the scale on which causes act, and back."""
    if link == "log":
        return [f"    {var} = np.log({var})"], [f"    {var} = np.exp({var})"]
    if link:
        trials = link.removeprefix("logit ")
        return (
            [f"    {var} = np.log({var} / ({trials} - {var}))"],
            [f"    {var} = {trials} / (1 + np.exp(-{var}))"],
        )
    return [], []


def _changed(part: _Part, var: str, does: str) -> list[str]:
    if part.code.does != does:
        return []
    given = [var if one == "simulated" else one for one in _arguments_of(part)]
    before = f"{var} = " if does == "responds" else f"{var} = {var} + "
    return [_call(part.function, [*given, *_numbers_of(part)], before)]


def _changed_by_own(
    parts: _Parts, own: tuple[FittedCause, str, dict[str, str]], var: str
) -> list[str]:
    one, name, numbers = own
    columns = (
        f"{{{', '.join(f'{_literal(key)}: {column}' for key, column in parts.columns.items())}}}"
    )
    lines = [f"    columns, numbers = {columns}, {_theta(one, numbers)}"]
    of_rows = f"np.full(len({var}), value) for key, value in numbers.items()"
    lines.append(f"    numbers = {{key: {of_rows}}}")
    if one.cause.responds:
        lines.append(f"    {var} = {name}.response({var}, columns, numbers)[0]")
    if one.coefficients:
        sizes = ", ".join(list(numbers)[len(one.theta) :])
        lines.append(f"    {var} = {var} + {name}.columns(columns, numbers) @ np.array([{sizes}])")
    return lines if len(lines) > 2 else []


# ---------------------------------------------------------------------------------------- ODE


def _varying(parts: _Parts) -> list[str]:
    """Return what solutions differ in: arguments of the right-hand side and of the start."""
    assert parts.ode is not None
    ode = parts.ode.function
    inside = [part for part in parts.coded if part.code.does in _INSIDE]
    numbers = [part.ids[key] for part in inside for key in (*part.code.numbers, *part.code.by_row)]
    names = [parts.ids[name] for name in (*ode.rate_names, *ode.start_names)]
    return list(dict.fromkeys([*names, *numbers]))


def _ode(model: ExtendedModel, parts: _Parts) -> list[str]:
    """Return the functions that solve the changed ODE."""
    assert parts.ode is not None
    ode, time = parts.ode.function, parts.ids[parts.ode.input_names[0]]
    varying = _varying(parts)
    late = [part for part in parts.coded if part.code.does == "delays"]
    # a step of "rk4" resolves what happens; one of a higher order sees as much in four
    most = 4 * ode.step if ode.method == "rk4" else ode.max_step
    step = min(most, ode.span / _LEAST_STEPS)
    parts.constants += [
        "# the dynamics",
        f"STATES = {_tuple(ode.states)}",
        f"START = {_text(ode.start)}",
        f"STEP = {_text(step)}  # the longest of the solver",
        f"SIZES = np.array([{', '.join(_text(size) for size in model.sizes)}])",
    ]
    start = "initial_state" if callable(ode.initial_state) else ""
    if not start:
        first = ode.initial_state
        values = [first[n] for n in ode.states] if isinstance(first, Mapping) else list(first)
        numbers = ", ".join(_text(float(np.ravel(value)[0])) for value in values)
        parts.constants.append(f"FIRST = np.array([{numbers}])")
    seen = ["seen"] if late else []
    slope = _call("right_hand_side", ["rhs", time, "state[:, None]", *seen, *varying], "return ", 8)
    given = {
        "rhs": ", ".join(["rhs", *([start] if start else []), "times", "*numbers"]),
        "own": ", ".join(["rhs", *([start] if start else []), "times[here]", "*own[:, None]"]),
        "definition": _definition(
            "solution", ["rhs", *([start] if start else []), "times", *varying]
        ),
        "time": time,
        "slope": slope + "[:, 0]",
        "method": _METHODS.get(ode.method, ode.method),
        "first": "    first = FIRST",
    }
    if start:
        call = _call("initial_state", _keywords(ode.start_names, parts.ids), "first = ")
        given["first"] = call + _FIRST
    lags = {ode.states.index(part.code.of): part.ids["lag"] for part in late}
    given["lags"] = ", ".join(f"{k}: float({lag}[0])" for k, lag in lags.items())
    solution = (_LATE_SOLUTION if late else _SOLUTION).format_map(given)
    return [_right_hand_side(parts, time, varying, seen), solution, _SOLUTIONS.format_map(given)]


def _right_hand_side(parts: _Parts, time: str, varying: Sequence[str], seen: Sequence[str]) -> str:
    assert parts.ode is not None
    ode = parts.ode.function
    lines = [_definition("right_hand_side", ["rhs", time, "state", *seen, *varying])]
    lines.append('    """Return the slopes of the states with what was found in them."""')
    inside = [part for part in parts.coded if part.code.does in _INSIDE]
    for part in inside:
        if part.code.does == "scales rate":
            rate = parts.ids[part.code.of]
            own = [*_arguments_of(part), *_numbers_of(part)]
            lines.append(_call(part.function, own, f"{rate} = {rate} * "))
    seen_state = seen[0] if seen else "state"
    called = [time, seen_state, *_keywords(ode.rate_names, parts.ids)]
    lines.append(_call("rhs", called, "slopes = "))
    lines.append("    slopes = np.array(slopes, dtype=float).reshape(state.shape)")
    for part in inside:
        if part.code.does == "adds to slope":
            states = {part.ids[key]: name for key, name in part.code.states.items()}
            own = [
                f"state[{ode.states.index(states[one])}]" if one in states else one
                for one in (*_arguments_of(part), *_numbers_of(part))
            ]
            at = ode.states.index(part.code.of)
            lines.append(_call(part.function, own, f"slopes[{at}] += "))
    return "\n".join([*lines, "    return slopes"])


_FIRST = """
    if isinstance(first, dict):
        first = [first[name] for name in STATES]
    first = np.array([float(np.ravel(value)[0]) for value in first])"""
_SOLUTIONS = '''def solutions({rhs}):
    """Return the states of rows, (n_states, n): equal numbers are one solution."""
    numbers = np.array(np.broadcast_arrays(times, *numbers)[1:])
    states = np.empty((len(STATES), len(times)))
    for own in np.unique(numbers, axis=1).T:
        here = np.all(numbers == own[:, None], axis=0)
        states[:, here] = solution({own})
    return states'''
_SOLUTION = '''{definition}
    """Return the states at times, (n_states, n), of one solution."""
{first}

    def derivative({time}, state):
{slope}

    latest = max(np.max(times), START + STEP)
    solved = solve_ivp(
        derivative,
        (START, latest),
        first,
        method="{method}",
        dense_output=True,
        rtol=1e-8,
        atol=1e-10 * SIZES,
        max_step=STEP,
    )
    if not solved.success:
        raise RuntimeError(solved.message)
    return solved.sol(times)'''
# one lag after the other, so that what was is known
_LATE_SOLUTION = '''{definition}
    """Return the states at times, (n_states, n), of one solution, one lag at a time."""
{first}
    lags = {{{lags}}}
    ends, solved = [START], []

    def late(moment):
        which = min(np.searchsorted(ends, moment), len(solved))
        return first if which == 0 else solved[which - 1](min(moment, ends[which]))

    def derivative({time}, state):
        seen = state.copy()
        for which, ago in lags.items():
            if ago > 0:
                seen[which] = late(min({time} - ago, ends[-1]))[which]
        seen = seen[:, None]
{slope}

    latest = max(np.max(times), START + STEP)
    longest = min([ago for ago in lags.values() if ago > 0], default=latest - START)
    longest = max(longest, (latest - START) / 2000)
    while ends[-1] < latest:
        piece = solve_ivp(
            derivative,
            (ends[-1], min(ends[-1] + longest, latest)),
            first if not solved else solved[-1](ends[-1]),
            method="{method}",
            dense_output=True,
            rtol=1e-8,
            atol=1e-10 * SIZES,
            max_step=STEP,
        )
        if not piece.success:
            raise RuntimeError(piece.message)
        solved.append(piece.sol)
        ends.append(piece.t[-1])
    return np.array([late(moment) for moment in times]).T'''
_HELPERS = {
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
    """Return the number of each row's level, and another one for levels not in the table."""
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
