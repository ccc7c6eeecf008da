"""The catalogue of causes as a page: each kind with formulas and a small picture of each form."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy import stats

import hybridsurrogate as hs
from hybridsurrogate.effects import Cause, Context
from hybridsurrogate.effects.picture import plot_cause
from hybridsurrogate.effects.registry import FORMS, Form, kinds
from hybridsurrogate.likelihoods import as_likelihood
from hybridsurrogate.model.context import at_medians, make_context, with_slopes
from hybridsurrogate.model.observation import MeasuredModel
from hybridsurrogate.surrogates.families.parametric import ExactBasis

# the row of each form in the tables of the page: the catalogue itself needs none
ROWS = Path(__file__).parent / "reference" / "causes.csv"
# what stands in a sentence for names, as in the formulas
_NAMES = {"output": "the output", "target": "`x`", "column": "`x`"}
_OTHERS = {
    "interaction": {"target": "`x1` and `x2`"},
    "parameter-by-experiment": {"target": "`parameter`", "column": "`e`"},
    "parameter-drift": {"target": "`parameter`"},
    "random-parameter": {"target": "`parameter`"},
    "narrow-prior": {"target": "`parameter`"},
    "wrong-constant": {"target": "`constant`"},
    "missing-term": {"target": "a state"},
}


def _tide(t, dose, height, rate, floor):
    return floor + height * np.sin(t) + rate * dose**2


def _rows() -> pd.DataFrame:
    rng, n = np.random.default_rng(11), 100
    return pd.DataFrame(
        {
            "t": np.linspace(0, 12, n),
            "dose": rng.permutation(np.linspace(0, 4, n)),
            "wind": rng.normal(0, 1, n),
            "batch": rng.permutation(np.arange(n) % 4 + 1.0),
        }
    )


def _parameters() -> dict[str, object]:
    return {
        "height": hs.truncated_normal(3, 0.5, 1, 5),
        "rate": hs.truncated_normal(0.5, 0.1, 0.1, 1),
    }


def _plain() -> hs.Simulator:
    return hs.Simulator(
        _tide,
        inputs={"t": (0, 12), "dose": (0, 4)},
        parameters=_parameters(),
        assumed={"floor": hs.Assumed(10.0, stats.norm(10, 1))},
        output="level",
    )


def _equation() -> hs.OdeSimulator:
    return hs.OdeSimulator(
        lambda t, state, rate: -rate * state,
        initial_state=lambda height: [height],
        observe=lambda state: state[0],
        inputs={"t": (0, 12)},
        states=("level",),
        parameters=_parameters(),
        output="level",
    )


def _context(simulator: hs.Simulator, likelihood: str = "normal", **changed: object) -> Context:
    frame = _rows().assign(**changed)
    # inputs come first
    frame = frame[[*simulator.input_names, *frame.columns.difference(simulator.input_names)]]
    columns, X = tuple(frame.columns), frame.to_numpy(dtype=float)
    n_inputs = len(simulator.input_names)
    basis = ExactBasis(np.empty(0), np.empty(0), simulator)
    context = make_context(
        simulator, columns, n_inputs, X, 1.0, as_likelihood(likelihood), basis, 0.0
    )
    assumed = {name: constant.value for name, constant in simulator.assumed.items()}
    parameters = dict(simulator.parameters)
    model = MeasuredModel(columns, n_inputs, parameters, assumed, (), 3.0, basis)
    return with_slopes(context, model, X, np.empty(0), at_medians(model))


def _contexts() -> Iterator[Context]:
    yield _context(_plain())
    yield _context(_equation())
    yield _context(_plain(), "lognormal")
    yield _context(_plain(), "poisson")
    yield _context(_plain(), dose=np.arange(100) % 3 * 2.0, wind=np.arange(100) % 25 * 1.0)


def drawn(form: Form, contexts: list[Context]) -> tuple[Cause, Context] | None:
    """Return a prepared cause of a form with its context; None where no context proposes one."""
    for context in contexts:
        for cause in form.propose(context):
            if form.trouble(cause, context) is None:
                return cause.prepare(context), context
    return None


def write_pictures(folder: Path) -> dict[str, str]:
    """Draw each form that can be drawn; return the file names by form."""
    folder.mkdir(parents=True, exist_ok=True)
    contexts, names = list(_contexts()), {}
    for form in FORMS.values():
        found = drawn(form, contexts)
        if found is None:
            continue
        # a layout that is computed takes half of the time
        figure = Figure(figsize=(3.2, 2.1), facecolor="white")
        ax = plot_cause(*found, ax=figure.add_axes((0.2, 0.23, 0.77, 0.64)))
        ax.set_title(form.name, fontsize="small")
        ax.tick_params(labelsize="x-small")
        name = "".join(c if c.isalnum() else "-" for c in form.name) + ".svg"
        figure.savefig(folder / name)
        names[form.name] = name
    return names


def catalogue(pictures: dict[str, str], folder: str) -> str:
    """Return the sections of the page in Markdown, one for each kind."""
    return "\n".join(_section(kind, pictures, folder) for kind in (*kinds(), "unexplained"))


def _section(kind: str, pictures: dict[str, str], folder: str) -> str:
    forms = [form for form in FORMS.values() if form.kind == kind]
    forms.sort(key=lambda form: form.name != kind)
    lines = [f"### {kind}", ""]
    meaning = forms[0].meaning
    if meaning:
        sentence = meaning.format_map(_NAMES | _OTHERS.get(kind, {}))
        lines += [f"{sentence[0].upper()}{sentence[1:]}.", ""]
    heads, rows = table()
    # a form without a row has its name alone
    cells = [rows.get(one.name, ["", f"`{one.cause.__name__}`"]) for one in forms]
    near = ", ".join(f"[{other}](#{other})" for other in cells[0][0].split())
    lines += [f"Easily taken for: {near}.", ""] if near else []
    shown = [pictures[form.name] for form in forms if form.name in pictures]
    if shown:
        lines += ["::::{grid} 1 2 3 3", ":gutter: 1"]
        for picture in shown:
            lines += [":::{grid-item}", f"![{picture[:-4]}]({folder}/{picture})", ":::"]
        lines += ["::::", ""]
    lines += [f"| {' | '.join(heads)} |", f"|{'---|' * len(heads)}"]
    lines += [f"| {' | '.join(row)} |" for _, *row in cells]
    return "\n".join([*lines, ""])


@cache
def table() -> tuple[list[str], dict[str, list[str]]]:
    """Return the heads of the tables, and the row of each form by its name, after its like."""
    with ROWS.open(encoding="utf-8", newline="") as file:
        (_, _, *heads), *rows = csv.reader(file)
    return heads, {name: cells for name, *cells in rows}
