"""What a module is written of: an extended model, the names of its causes, its estimates."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from hybridsurrogate.diagnosis.source.text import (
    RESERVED,
    Names,
    array_of,
    estimate,
    inline,
    literal,
    text_of,
    tuple_of,
)
from hybridsurrogate.effects.base import Cause, Rows
from hybridsurrogate.effects.dynamics.dynamic import DynamicDelay, DynamicStore
from hybridsurrogate.effects.dynamics.dynamic_drift import DynamicDrift
from hybridsurrogate.effects.dynamics.dynamic_term import DynamicTerm
from hybridsurrogate.effects.expressions import Code, LevelTable, names_in
from hybridsurrogate.likelihoods import Binomial, Likelihood
from hybridsurrogate.numerics.digits import interval
from hybridsurrogate.ode.dynamics import (
    CoupledStore,
    DelayedState,
    MissingTerm,
    TimeVaryingParameter,
)
from hybridsurrogate.ode.simulator import OdeSimulator
from hybridsurrogate.simulation.modification import Modification
from hybridsurrogate.simulation.simulator import Simulator
from hybridsurrogate.types import FloatArray

# where a logarithm differs from the identity
_TRIED = np.array([0.3, 2.0])


@dataclass(frozen=True)
class FittedCause:
    """A prepared cause, and draws of its parameters and coefficients, (n_draws,) each."""

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
    written_by : str
        Its last one: where the numbers come from.
    returns_dict : bool
        Whether a function of one output returns it in a dict.
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
    written_by: str = ""
    functions: tuple[tuple[str, str], ...] = ()
    returns_dict: bool = False


def link_of(likelihood: Likelihood) -> tuple[str, str]:
    """Return the scale on which causes act, and a word for it."""
    # causes do not act on limits of measurements
    plain = getattr(likelihood, "plain", likelihood)
    if isinstance(plain, Binomial):
        return f"logit {plain.trials}", "log odds of "
    eta = np.asarray(plain.link(_TRIED))
    if np.allclose(eta, np.log(_TRIED)):
        return "log", "log "
    if np.allclose(eta, _TRIED):
        return "", ""
    raise ValueError(
        f"The likelihood {plain.name!r} has a link that is not written as Python: it "
        "is neither the output nor its logarithm."
    )


# what rewrites the measured rows: a subclass that overrides one of these has no code any more
_REWRITES = ("inputs", "gain", "response", "columns", "factors", "noise", "estimates")


@dataclass(frozen=True)
class SourcePart:
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
            **{k: k for k in code.numbers if k not in others and k not in RESERVED},
        }


_INSIDE = ("scales rate", "adds to slope", "delays")


class SourceParts:
    """All names and numbers of a module."""

    def __init__(self, model: ExtendedModel):
        self.model = model
        self.names = Names(RESERVED)
        self.constants: list[str] = []
        # arguments of `extended`, their estimates in words and their units, for a docstring
        self.estimates: list[tuple[str, str, str]] = []
        simulator = model.simulator
        if len(model.outputs) > 1:
            self.constants.append(f"OUTPUTS = {tuple_of(model.outputs)}")
        self.ode = simulator if isinstance(simulator, OdeSimulator) else None
        # what is passed to solve it: the function of the start, where there is one
        self.start = ["initial_state"] if self.ode and callable(self.ode.initial_state) else []
        self.link, self.word = link_of(model.likelihood)
        causes = [(one, code_of(one.cause)) for one in model.causes if one.cause.is_learned]
        read = [c for _, code in causes if code for c in code.columns.values()]
        read += [column for one, code in causes if code is None for column in one.cause.reads]
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
            for one, code in causes
            if code is not None and code.does == "replaces"
        }
        self._constant_of_parameters()
        self.coded: list[SourcePart] = []
        self.own: list[tuple[FittedCause, str, dict[str, str]]] = []
        # of several outputs the one that such a cause concerns, and the unit that it knows
        self.unit_of_own: dict[str, tuple[str, float]] = {}
        self._of_simulator()
        for one, code in causes:
            if code is None:
                self.own.append(self._own(one))
            elif code.does not in ("replaces", "nothing"):
                self.coded.append(self._part(one, code))

    def dynamic(self) -> list[SourcePart]:
        """Return the causes that change the dynamics."""
        return [part for part in self.coded if part.code.does in _INSIDE]

    def defaults(self) -> dict[str, str]:
        """Return the arguments of `extended` after the columns, with their defaults."""
        out = {self.parameters[name]: self._defaults[name] for name in self.parameters}
        for part in self.coded:
            if part.code.does != "scatters":
                out |= part.numbers
        for _, _, numbers in self.own:
            out |= numbers
        return out

    def unit(self, template: str, code: Code) -> str:
        """Return a unit of which the names stand in braces."""
        model = self.model
        output = code.output or (model.outputs[0] if len(model.outputs) == 1 else "y")
        plain = model.units.get(output, output)
        known = {"plain": plain, "y": f"{self.word}{plain}"}
        known["t"] = model.units.get(model.inputs[0], model.inputs[0]) if model.inputs else "t"
        own = {**code.columns, **code.states, "of": code.of}
        known |= {key: model.units.get(name, name) for key, name in own.items()}
        known.setdefault("state", model.units.get(code.of, code.of))
        return inline(template.format_map(known))

    def _draws(self, one: FittedCause) -> dict[str, FloatArray]:
        estimates = one.cause.estimates(one.theta, one.coefficients)
        return {**one.theta, **one.coefficients, **estimates}

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
        value, known = estimate(draws)
        unit = f"[{inline(unit)}]" if unit not in ("", "1") else ""
        if known:
            ends = np.quantile(draws, [0.05, 0.95]).tolist()
            self.estimates.append((name, interval(float(np.mean(draws)), *ends), unit))
        words = " ".join(filter(None, [known, note, unit]))
        self.constants.append(f"{constant} = {value}" + (f"  # {words}" if words else ""))
        return constant

    def _heading(self, cause: Cause) -> None:
        self.constants.append(f"# {inline(cause.name)}")

    def _of_simulator(self) -> None:
        """Take in changes of the dynamics that the simulation had before."""
        for change in self.ode.modifications if self.ode is not None else ():
            names = {name: change.full(name) for name in change.neutral}
            if not all(full in self.ids for full in names.values()):
                continue  # at numbers that change nothing
            cause = as_cause(change)
            code = cause.code()
            assert code is not None
            ids = {name: self.ids[full] for name, full in names.items()}
            function = self.function_name(cause, cause.kind, names)
            self.coded.append(self._coded(cause, code, function, ids, {}))

    def function_name(self, cause: Cause, wanted: str, numbers: Iterable[str]) -> str:
        """Return a name for a cause's function that none of its numbers has."""
        inner = cause.inner
        plain = re.sub(r"\W", "_", wanted)
        if plain in numbers:
            plain = f"{plain}_effect"
        free = f"{plain}_{inner.target}" if plain in self.names.taken and inner.target else plain
        return self.names.new(free)

    def _number(self, function: str, name: str) -> str:
        return self.names.new(f"{function}_{name}" if name in self.names.taken else name)

    def _own(self, one: FittedCause) -> tuple[FittedCause, str, dict[str, str]]:
        numbers: dict[str, str] = {}
        inner, output, scale = one.cause.inner, one.cause.output, one.cause.unit_of_output
        sized = {name: scale * draws for name, draws in one.coefficients.items()}
        one = FittedCause(inner, one.theta, sized)
        self._heading(one.cause)
        own = {**one.theta, **one.coefficients}
        function = self.function_name(one.cause, one.cause.kind, own)
        for name, draws in own.items():
            argument = self._number(function, name)
            numbers[argument] = self._constant(argument, draws)
        if output:
            self.unit_of_own[function] = output, scale
        return one, function, numbers

    def _part(self, one: FittedCause, code: Code) -> SourcePart:
        draws = self._draws(one)
        ids: dict[str, str] = {}
        numbers: dict[str, str] = {}
        self._heading(one.cause)
        function = self.function_name(one.cause, code.name or one.cause.kind, code.numbers)
        for name, unit in code.numbers.items():
            ids[name] = self._number(function, name)
            numbers[ids[name]] = self._constant(ids[name], draws[name], self.unit(unit, code))
        if code.table is not None:
            ids["table"] = self.names.new(f"by_{code.table.column}")
            numbers[ids["table"]] = self._table(code.table, code, ids["table"], draws)
        if code.tables is not None:
            for name, values in code.tables(one.theta, one.coefficients).items():
                ids[name] = self.names.new(name.upper())
                self.constants += array_of(ids[name], values)
        if "{sigma}" in code.expression:
            sigma = self.model.sigma.get(code.output or self.model.outputs[0], np.ones(1))
            numbers["sigma"] = self._constant("noise_sd", sigma, self.unit("{y}", code))
        return self._coded(one.cause, code, function, ids, numbers)

    def _table(self, table: LevelTable, code: Code, name: str, draws: Rows) -> str:
        constant = self.names.new(name.upper())
        unit = self.unit(table.unit, code)
        lines = [f"{constant} = {{" + (f"  # [{unit}]" if unit != "1" else "")]
        for level, number in table.levels:
            value, known = estimate(draws[number])
            note = f"  # {known}" if known else ""
            lines.append(f"    {self.level(table.column, level)}: {value},{note}")
        self.constants += [*lines, "}"]
        return constant

    def level(self, column: str, value: float) -> str:
        """Return a value of a column of labels as a literal."""
        labels = self.model.labels.get(column)
        return literal(labels[int(value)]) if labels else text_of(value)

    def _coded(
        self,
        cause: Cause,
        code: Code,
        function: str,
        ids: Mapping[str, str],
        numbers: Mapping[str, str],
    ) -> SourcePart:
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
        return SourcePart(cause, code, function, every, dict(numbers))


def code_of(cause: Cause) -> Code | None:
    """Return the code of a cause; None for a user's, and where a subclass does something else."""
    for one in type(cause.inner).__mro__:
        # the expression of a shape is its code
        if not vars(one).keys().isdisjoint(("code", "expression")):
            return cause.code()
        if not vars(one).keys().isdisjoint(_REWRITES):
            return None
    return None


def as_cause(change: Modification) -> Cause:
    """Return the cause that makes a change of the dynamics."""
    if isinstance(change, TimeVaryingParameter):
        return DynamicDrift(change.parameter, change.shape, center=change.center)
    if isinstance(change, MissingTerm):
        return DynamicTerm(
            change.state, change.form, center=change.center, size=change.size, other=change.other
        )
    if isinstance(change, DelayedState):
        return DynamicDelay(change.state)
    if isinstance(change, CoupledStore):
        return DynamicStore(change.state, through=change.through, divides=change.divides)
    raise ValueError(
        f"The simulation has a change of its dynamics that is not written as Python: {change!r}."
    )


def placeholders(code: Code) -> set[str]:
    """Return the names in braces."""
    texts = [code.expression, *code.steps.values()]
    return {name for text in texts for name in names_in(text)}


def arguments_of(part: SourcePart) -> list[str]:
    """Return the names of a cause's function's arguments without a default."""
    code, ids = part.code, part.ids
    used = placeholders(code)
    keys = [*(["simulated"] if "simulated" in used else []), *(["of"] if "of" in used else [])]
    keys += [key for key in code.columns if key in used]
    keys += [key for key in code.states if key in used]
    keys += [*(["t"] if "t" in used else []), *code.arguments, *code.by_row]
    return list(dict.fromkeys(ids[key] for key in keys))


def call_values_of(part: SourcePart) -> list[str]:
    """Return the cause's numbers as its function takes them, its table last."""
    used = {part.ids[key] for key in placeholders(part.code)}
    own = [part.ids[key] for key in part.code.numbers] + list(part.numbers)
    return [name for name in dict.fromkeys(own) if name in used]


def own_arguments(parts: SourceParts) -> list[str]:
    """Return the arguments of `extended` that are the user's functions."""
    own = ["simulation"] if parts.ode is None else ["rhs", *parts.start, "observe"]
    return [*own, *(name for _, name, _ in parts.own)]
