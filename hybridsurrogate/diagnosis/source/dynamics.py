"""The functions of a module that solve a changed ODE."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from hybridsurrogate.diagnosis.source.parts import (
    ExtendedModel,
    SourceParts,
    arguments_of,
    call_values_of,
)
from hybridsurrogate.diagnosis.source.text import (
    call,
    definition,
    inline,
    keywords,
    literal,
    text_of,
    tuple_of,
)
from hybridsurrogate.ode.steps import MIN_STEPS

# methods of the module by those of the simulator; others are scipy's own
_METHODS = {"rk4": "DOP853", "rosenbrock": "Radau"}


def varying_in(parts: SourceParts) -> list[str]:
    """Return what solutions differ in: arguments of the right-hand side and of the start."""
    assert parts.ode is not None
    ode = parts.ode.function
    numbers = [
        part.ids[key] for part in parts.dynamic() for key in (*part.code.numbers, *part.code.by_row)
    ]
    names = [parts.ids[name] for name in (*ode.rate_names, *ode.start_names)]
    return list(dict.fromkeys([*names, *numbers]))


def dynamics(model: ExtendedModel, parts: SourceParts) -> list[str]:
    """Return the functions that solve the changed ODE."""
    assert parts.ode is not None
    ode, time = parts.ode.function, parts.ids[parts.ode.input_names[0]]
    varying = varying_in(parts)
    late = [part for part in parts.coded if part.code.does == "delays"]
    stores = [part for part in parts.coded if part.code.unseen]
    sizes = [*model.sizes, *(model.sizes[ode.states.index(one.code.of)] for one in stores)]
    # a step of "rk4" resolves what happens; one of a higher order sees as much in four
    most = 4 * ode.step if ode.method == "rk4" else ode.max_step
    # a sudden change must not be stepped over
    step = min(most, ode.span / MIN_STEPS)
    parts.constants += [
        "# the dynamics",
        f"STATES = {tuple_of(ode.states)}",
        f"START = {text_of(ode.start)}",
        f"STEP = {text_of(step)}  # the longest of the solver",
        f"SIZES = np.array([{', '.join(text_of(size) for size in sizes)}])",
        "SOLVER = {",
        f'    "method": "{_METHODS.get(ode.method, ode.method)}",',
        '    "dense_output": True,',
        '    "rtol": 1e-8,',
        '    "atol": 1e-10 * SIZES,',
        '    "max_step": STEP,',
        "}",
    ]
    if not parts.start:
        first = ode.initial_state
        values = [first[n] for n in ode.states] if isinstance(first, Mapping) else list(first)
        numbers = ", ".join(text_of(float(np.ravel(value)[0])) for value in values)
        parts.constants.append(f"FIRST = np.array([{numbers}])")
    seen = ["seen"] if late else []
    slope = call("right_hand_side", ["rhs", time, "state[:, None]", *seen, *varying], "return ", 8)
    given = {
        "rhs": ", ".join(["rhs", *parts.start, "times", "*numbers"]),
        "own": ", ".join(["rhs", *parts.start, "times[here]", "*own[:, None]"]),
        "definition": definition("solution", ["rhs", *parts.start, "times", *varying]),
        "time": time,
        "slope": slope + "[:, 0]",
        "first": "    first = FIRST",
    }
    if parts.start:
        asked = call("initial_state", keywords(ode.start_names, parts.ids), "first = ")
        given["first"] = asked + _FIRST
    for one in stores:
        at = ode.states.index(one.code.of)
        given["first"] += f"\n    first = np.append(first, first[{at}] + {one.ids['gap']}[0])"
    lags = {ode.states.index(part.code.of): part.ids["lag"] for part in late}
    given["lags"] = ", ".join(f"{k}: float({lag}[0])" for k, lag in lags.items())
    solution = (_LATE_SOLUTION if late else _SOLUTION).format_map(given)
    own = [_right_hand_side(parts, time, varying, seen), solution, _SOLUTIONS.format_map(given)]
    return [_MOVED_TERM, *own] if any(one.code.through for one in stores) else own


def _right_hand_side(
    parts: SourceParts, time: str, varying: Sequence[str], seen: Sequence[str]
) -> str:
    assert parts.ode is not None
    ode = parts.ode.function
    lines = [definition("right_hand_side", ["rhs", time, "state", *seen, *varying])]
    lines.append('    """Return the slopes of the states with the detected causes in them."""')
    inside = parts.dynamic()
    for part in inside:
        if part.code.does == "scales rate":
            rate = parts.ids[part.code.of]
            own = [*arguments_of(part), *call_values_of(part)]
            lines.append(call(part.function, own, f"{rate} = {rate} * "))
    n_states = len(ode.states)
    kept = f"[:{n_states}]" if any(part.code.unseen for part in inside) else ""
    called = [time, (seen[0] if seen else "state") + kept, *keywords(ode.rate_names, parts.ids)]
    lines.append(call("rhs", called, "slopes = "))
    lines.append(f"    slopes = np.array(slopes, dtype=float).reshape(state{kept}.shape)")
    terms, moved = _moved_terms(parts, time, called[1])
    lines += moved
    for part in inside:
        if part.code.does != "adds to slope":
            continue
        states, at = part.code.states, ode.states.index(part.code.of)
        # unseen ones come last
        rows = {
            part.ids[key]: n_states if key == "store" else ode.states.index(name)
            for key, name in states.items()
        }
        own = [
            f"state[{rows[one]}]" if one in rows else one
            for one in (*arguments_of(part), *call_values_of(part))
        ]
        if not part.code.unseen:
            lines.append(call(part.function, own, f"slopes[{at}] += "))
            continue
        n_states += 1
        lines.append(call(part.function, own, "added = "))
        lines.append(f"    slopes[{at}] += added")
        own_term = f"{terms[part.code.through[0]]}[{at}] " if part.code.through else ""
        whole = f"({own_term}- added)" if own_term else "-added"
        lines.append(f"    slopes = np.vstack([slopes, {whole} / {part.ids['ratio']}])")
    return "\n".join([*lines, "    return slopes"])


def _moved_terms(parts: SourceParts, time: str, state: str) -> tuple[dict[str, str], list[str]]:
    """Return the terms that act on unseen states by parameter, and lines that move them there."""
    assert parts.ode is not None
    ode, lines, terms = parts.ode.function, [], dict[str, str]()
    stores = [part.code for part in parts.dynamic() if part.code.unseen]
    moved = dict.fromkeys(one.through for one in stores if one.through is not None)
    for name, without in moved:
        term = terms[name] = parts.names.new(f"term_of_{name}")
        rows = {
            ode.states.index(one.of): len(ode.states) + k
            for k, one in enumerate(stores)
            if one.through is not None and one.through[0] == name
        }
        given = ["rhs", time, literal(name), text_of(without), *keywords(ode.rate_names, parts.ids)]
        lines += [
            f"    # of the store, no longer of the state: the term of {inline(name)}",
            f"    there = {state}.copy()",
            *(f"    there[{row}] = state[{unseen}]" for row, unseen in rows.items()),
            call("moved_term", [state, *given], "gone = "),
            call("moved_term", ["there", *given], f"{term} = "),
            f"    slopes += {term} - gone",
            *(f"    slopes[{row}] -= {term}[{row}]" for row in rows),
        ]
    return terms, lines


_MOVED_TERM = '''def moved_term(state, rhs, moment, name, without, /, **given):
    """Return what slopes lose with a parameter as it is without its term."""
    slopes = rhs(moment, state, **given)
    rest = rhs(moment, state, **{**given, name: without})
    return np.subtract(slopes, rest).reshape(state.shape)'''


_FIRST = """
    if isinstance(first, dict):
        first = [first[name] for name in STATES]
    first = np.array([float(np.ravel(value)[0]) for value in first])"""


_SOLUTIONS = '''def solutions({rhs}):
    """Return the states of rows, (n_states, n): equal numbers are one solution."""
    numbers = np.array(np.broadcast_arrays(times, *numbers)[1:])
    states = np.empty((len(SIZES), len(times)))
    for own in np.unique(numbers, axis=1).T:
        here = np.all(numbers == own[:, None], axis=0)
        states[:, here] = solution({own})
    return states[: len(STATES)]'''


_SOLUTION = '''{definition}
    """Return the states at times, (n_states, n), of one solution."""
{first}

    def derivative({time}, state):
{slope}

    latest = max(np.max(times), START + STEP)
    solved = solve_ivp(derivative, (START, latest), first, **SOLVER)
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
            **SOLVER,
        )
        if not piece.success:
            raise RuntimeError(piece.message)
        solved.append(piece.sol)
        ends.append(piece.t[-1])
    return np.array([late(moment) for moment in times]).T'''
