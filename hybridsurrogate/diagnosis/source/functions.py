"""The functions of a module: one of each cause, and the extended simulation."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping

from hybridsurrogate.diagnosis.source.dynamics import varying_in
from hybridsurrogate.diagnosis.source.parts import (
    ExtendedModel,
    FittedCause,
    SourcePart,
    SourceParts,
    arguments_of,
    call_values_of,
    own_arguments,
    placeholders,
)
from hybridsurrogate.diagnosis.source.text import (
    LINE_WIDTH,
    call,
    definition,
    dict_of,
    inline,
    keywords,
    literal,
    text_of,
)
from hybridsurrogate.numerics.digits import listing


def function_of(part: SourcePart, parts: SourceParts) -> str:
    """Return the function of a cause."""
    code, ids = part.code, part.inside
    short = {part.ids[key]: ids[key] for key in part.ids}
    arguments = arguments_of(part)
    arguments += [
        f"{short.get(name, name)}={part.numbers[name]}" if name in part.numbers else short[name]
        for name in call_values_of(part)
    ]
    lines = [definition(part.function, arguments), f'    """{_does(part, parts)}"""']
    used = placeholders(code)
    for key, value in code.constants.items():
        lines.append(f"    {ids[key]} = {text_of(value)}")
    for key, (low, high, n) in code.grids.items():
        lines.append(f"    {ids[key]} = np.linspace({text_of(low)}, {text_of(high)}, {n})")
    if "step" in used and parts.ode is not None:
        lines.append(f"    {ids['step']} = {text_of(parts.ode.function.step)}")
    for key, text in code.steps.items():
        lines.append(f"    {ids[key]} = {text.format_map(ids)}")
    lines.append(f"    return {code.expression.format_map(ids)}")
    return "\n".join(lines)


def _does(part: SourcePart, parts: SourceParts) -> str:
    code, word = part.code, parts.word
    output = code.output or listing(list(parts.model.outputs))
    said = {
        "adds": f"Return what is added to {word}{output}: {part.cause.name}.",
        "responds": f"Return what becomes of {word}{output}: {part.cause.name}.",
        "moves": f"Return {code.of} as the simulation is run with: {part.cause.name}.",
        "scales rate": f"Return the factor on {code.of} at a time.",
        "adds to slope": f"Return what is added to the slope of {code.of}.",
        "delays": f"Return how long ago the slopes see {code.of}.",
        "noise_sd": f"Return the standard deviation of the noise of {word}{output}.",
        "noise_covariance": f"Return the covariance of correlated noise of {word}{output}.",
        "noise_variance": f"Return the variance of counts of {output}.",
        "noise_draws": f"Return draws of the noise of {word}{output}.",
    }
    text = inline(said[code.name if code.does == "scatters" else code.does])
    # a name that is too long stands in the docstring of the module
    return text if len(text) <= LINE_WIDTH - 10 else f"{text.partition(': ')[0].rstrip('.')}."


def extended_function(model: ExtendedModel, parts: SourceParts) -> str:
    """Return the function that runs the simulation with the causes in it."""
    defaults = parts.defaults()
    arguments = [*own_arguments(parts), *parts.columns.values()]
    arguments += [f"{name}={default}" for name, default in defaults.items()]
    outputs = inline(listing(list(model.outputs)))
    lines = [definition("extended", arguments)]
    lines += [f'    """Return {outputs} of the extended simulation.', ""]
    lines += [*_explained(model, parts), '    """']
    labelled = [parts.columns[c] for c in model.labels if c in parts.columns]
    numeric = [c for c in parts.columns.values() if c not in labelled]
    numeric += list(parts.parameters.values())
    targets = f"({numeric[0]},)" if len(numeric) == 1 else ", ".join(numeric)
    lines.append(call("rows", numeric, f"{targets} = " if numeric else ""))
    lines += [f"    {name} = np.asarray({name})" for name in labelled]
    now = dict(parts.ids)
    return "\n".join(
        [*lines, *_moves(parts, now), *_run(model, parts, now), *_changes(model, parts)]
    )


def _explained(model: ExtendedModel, parts: SourceParts) -> list[str]:
    units = {c: f" [{model.units[c]}]" for c in parts.columns if c in model.units}
    columns = listing([f"{n}{units.get(c, '')}" for c, n in parts.columns.items()])
    names = list(dict.fromkeys([*model.inputs, *model.parameters, *model.assumed]))
    of = listing([inline(name) for name in names])
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
    return [f"    {line}" for each in text for line in textwrap.wrap(inline(each), LINE_WIDTH - 4)]


def _moves(parts: SourceParts, now: dict[str, str]) -> list[str]:
    """Return lines that move columns and parameters; what stands for them comes into `now`."""
    lines = []
    for part in parts.coded:
        for key, text in part.code.by_row.items():
            lines.append(f"    {part.ids[key]} = {text.format_map(part.ids)}")
        if part.code.does != "moves":
            continue
        of = part.code.of
        current = {parts.ids[name]: now[name] for name in parts.ids}
        given = [current.get(one, one) for one in (*arguments_of(part), *call_values_of(part))]
        if of in parts.columns and now[of] == parts.ids[of]:
            # what is added looks at the column as it was measured
            now[of] = parts.names.new(f"run_{parts.ids[of]}")
        lines.append(call(part.function, given, f"{now[of]} = "))
    for one, name, numbers in parts.own:
        if "inputs" in one.cause.acts_on:
            lines += _moves_of_own(parts, now, name, one, numbers)
    return lines


def _moves_of_own(
    parts: SourceParts, now: dict[str, str], name: str, one: FittedCause, numbers: Mapping[str, str]
) -> list[str]:
    columns, points = (
        dict_of({key: now[key] for key in keys}) for keys in (parts.columns, parts.parameters)
    )
    lines = [f"    columns, numbers = {name}.inputs({columns}, {points}, {_theta(one, numbers)})"]
    for key in parts.columns:
        if now[key] == parts.ids[key]:
            now[key] = parts.names.new(f"run_{parts.ids[key]}")
        lines.append(f"    {now[key]} = columns[{literal(key)}]")
    return lines + [f"    {now[key]} = numbers[{literal(key)}]" for key in parts.parameters]


def _theta(one: FittedCause, numbers: Mapping[str, str]) -> str:
    """Return a user-defined cause's parameters as a dict."""
    return dict_of(dict(zip(one.theta, numbers, strict=False)))


def _run(model: ExtendedModel, parts: SourceParts, now: Mapping[str, str]) -> list[str]:
    """Return lines that run the simulation."""
    several = len(model.outputs) > 1
    if parts.ode is not None:
        ode, time = parts.ode.function, now[parts.ode.input_names[0]]
        lines = [f"    {time} = np.maximum({time}, START)"]
        solved = ["rhs", *parts.start, time, *(now.get(n, n) for n in varying_in(parts))]
        lines.append(call("solutions", solved, "states = "))
        seen = ["states", *keywords(ode.observe_names, now)]
        lines.append(call("observe", seen, "output = "))
        return [*lines, "    outputs = by_name(output, axis=0)"] if several else lines
    names = [*model.inputs, *model.parameters, *model.assumed]
    given = keywords(names, now)
    simulator = model.simulator
    way, one = "simulation", []
    if simulator is not None and not simulator.vectorized:
        way = "in_curves" if simulator.returns == "curve" else "each_row"
        one = ["lambda **own: [*by_name(simulation(**own)).values()]" if several else "simulation"]
    lines = [call(way, [*one, *given], "output = ")]
    if model.returns_dict:
        lines.append(f"    output = output[{literal(model.outputs[0])}]")
    if several:
        lines.append(f"    outputs = by_name({'[*output]' if way == 'in_curves' else 'output'})")
    return lines


def _changes(model: ExtendedModel, parts: SourceParts) -> list[str]:
    """Return lines that make of the simulated output the extended one."""
    outer = [p for p in parts.coded if p.code.does in ("responds", "adds")]
    several = len(model.outputs) > 1
    lines = []
    for name in model.outputs:
        own = [p for p in outer if p.code.output in (None, name)]
        var = f"outputs[{literal(name)}]" if several else "output"
        if own or parts.own:
            into, back = _scale(parts.link, var)
            changed = [line for part in own for line in _changed(part, var, "responds")]
            changed += [
                line for one in parts.own for line in _changed_by_own(parts, one, name, var)
            ]
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


def _changed(part: SourcePart, var: str, does: str) -> list[str]:
    if part.code.does != does:
        return []
    given = [var if one == "simulated" else one for one in arguments_of(part)]
    before = f"{var} = " if does == "responds" else f"{var} = {var} + "
    return [call(part.function, [*given, *call_values_of(part)], before)]


def _changed_by_own(
    parts: SourceParts, own: tuple[FittedCause, str, dict[str, str]], output: str, var: str
) -> list[str]:
    one, name, numbers = own
    only, unit = parts.unit_of_own.get(name, (output, 1.0))
    if only != output:
        return []
    lines = [f"    columns, numbers = {dict_of(parts.columns)}, {_theta(one, numbers)}"]
    of_rows = f"np.full(len({var}), value) for key, value in numbers.items()"
    lines.append(f"    numbers = {{key: {of_rows}}}")
    if {"gain", "response"} & one.cause.acts_on:
        scaled = (var, "") if unit == 1.0 else (f"{var} / {unit!r}", f"{unit!r} * ")
        changed = f"{scaled[1]}{name}.response({scaled[0]}, columns, numbers)[0]"
        lines.append(f"    {var} = {changed}")
    if one.coefficients:
        sizes = ", ".join(list(numbers)[len(one.theta) :])
        lines.append(f"    {var} = {var} + {name}.columns(columns, numbers) @ np.array([{sizes}])")
    return lines if len(lines) > 2 else []
