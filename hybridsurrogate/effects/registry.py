"""The registry of causes: each class of effects/ registers its forms.

A new cause is one class in a room of effects/: it is imported, exported, proposed to every
diagnosis, shown in reports and listed in the documentation because it registers itself.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

from hybridsurrogate.effects.base import Cause, Context
from hybridsurrogate.registration import add, import_all

# what may not be excluded: a curve of any shape is always compared
_ALWAYS = "unexplained"
# arguments that a cause needs, as the table writes them
_SHORT = {"column": "x", "by": "e", "parameter": "p", "constant": "c", "quantity": "p"}
_SHORT |= {"first": "x1", "second": "x2"}
_ROOMS = ("output", "inputs", "response", "parameters", "dynamics", "noise")


@dataclass(frozen=True)
class Form:
    """One form of a kind of cause, and when it is compared.

    Attributes
    ----------
    name : str
        The kind, and after a colon the form where it is not the plain one.
    cause : type of Cause
    propose : callable
        Takes a `Context` and yields the causes of this form that can be estimated there.
    meaning : str or None
        What it means for the one who wrote the simulation, for a report: a sentence in which
        {output}, {target} and {column} stand for names. None: as for the plain form.
    headline : str or None
        What is wrong, as the first sentence of a report: {output}, {target} and {column} stand for
        names, {amplitude} and other estimates for values with units. ``{amplitude:size}`` is
        without its sign, ``{amplitude:rises|falls}`` a word by the sign. None: as for the plain
        form.
    least_rows, least_distinct : int
        Measured rows, and distinct values of the columns it looks at, that it needs.
    trouble : callable
        Takes a cause and a `Context` and returns why it cannot be compared there; None: it can.
    lacking : callable
        Takes a `Context` and returns pairs (target, reason) for what is not proposed there.
    only_alone : bool
        Whether it stands for two causes at once, and is needless where a second one is searched.
    like : tuple of str
        Kinds whose curves it is easily taken for.
    call, formula, priors, estimates, left_out : str
        Cells of the documentation's table; `cells` finds an empty call or formula in the class.
    """

    name: str
    cause: type[Cause]
    propose: Callable[[Context], Iterable[Cause]] = lambda context: ()
    meaning: str | None = None
    headline: str | None = None
    least_rows: int = 4
    least_distinct: int = 2
    trouble: Callable[[Cause, Context], str | None] = lambda cause, context: None
    lacking: Callable[[Context], Iterable[tuple[str | None, str]]] = lambda context: ()
    only_alone: bool = False
    like: tuple[str, ...] = ()
    call: str = ""
    formula: str = ""
    priors: str = ""
    estimates: str = ""
    left_out: str = ""

    @property
    def kind(self) -> str:
        """The word by which reports call the kind."""
        return self.name.partition(": ")[0]

    @property
    def cells(self) -> tuple[str, ...]:
        """Call, formula, priors, estimates, and when it is left out."""
        call, formula = self.call or _call_of(self.cause), self.formula or _formula_of(self.cause)
        return call, formula, self.priors, self.estimates, self.left_out


def _call_of(cause: type[Cause]) -> str:
    """Return how a cause is made from names alone."""
    arguments = inspect.signature(cause).parameters.values()
    needed = [_SHORT.get(one.name, one.name) for one in arguments if one.default is one.empty]
    return f"`{cause.__name__}({', '.join(needed)})`"


def _formula_of(cause: type[Cause]) -> str:
    """Return the first formula of a cause's docstring, as the table writes it."""
    found = re.search(r"``([^`]*simulation[^`]*)``", cause.__doc__ or "")
    text = " ".join(found[1].split()) if found else ""
    return text.replace("simulation", "eta").replace("gain * eta", "gain eta").replace("^2", "²")


FORMS: dict[str, Form] = {}


def register(form: Form) -> None:
    """Make a form part of the catalogue.

    Raises
    ------
    TypeError
        For a form of something else than a class of causes.
    ValueError
        If its name begins with another word than the kind of its class, or is taken.
    """
    if not (isinstance(form.cause, type) and issubclass(form.cause, Cause)):
        raise TypeError(f"Form({form.name!r}, ...) needs a subclass of Cause, got {form.cause!r}.")
    if form.kind != form.cause.kind:
        raise ValueError(
            f"Form({form.name!r}, ...) must begin with the kind of {form.cause.__name__}, "
            f"{form.cause.kind!r}, and may go on with ': ' and a word for the form."
        )
    add(FORMS, form.name, form, lambda one: one.cause)


def load_causes() -> None:
    """Import every file of the rooms of effects/, so that its causes register themselves."""
    for room in _ROOMS:
        import_all(f"{__package__}.{room}")


def kinds() -> tuple[str, ...]:
    """Return the kinds that may be excluded from a diagnosis."""
    return tuple(dict.fromkeys(f.kind for f in FORMS.values() if f.kind != _ALWAYS))


def classes() -> dict[str, type[Cause]]:
    """Return every registered class by its name."""
    return {form.cause.__name__: form.cause for form in FORMS.values()}


def over_inputs(make: Callable[[str], Cause]) -> Callable[[Context], Iterator[Cause]]:
    """Return what proposes one cause for each input of the simulation."""
    return lambda context: (make(column) for column in context.inputs)


def over_extras(make: Callable[[str], Cause]) -> Callable[[Context], Iterator[Cause]]:
    """Return what proposes one cause for each measured column that the simulation ignores."""
    return lambda context: (make(column) for column in context.extras)


def over_columns(make: Callable[[str], Cause]) -> Callable[[Context], Iterator[Cause]]:
    """Return what proposes one cause for each measured column that is an axis."""
    return lambda context: (make(column) for column in (*context.inputs, *context.extras))


def meaning_of(cause: Cause) -> str | None:
    """Return what a cause means, in words with places for names; None where nothing is known."""
    first = (cause.variant.split() or [""])[0]
    forms = (FORMS.get(f"{cause.kind}: {first}"), FORMS.get(cause.kind))
    meanings = (form.meaning for form in forms if form is not None and form.meaning)
    return cause.meaning or next(meanings, None)


def headline_of(cause: Cause) -> str | None:
    """Return the first sentence of a report about a cause, with places for names and estimates."""
    whole = f"{cause.kind}: {cause.variant}"
    own = [name for name in FORMS if name == whole or whole.startswith(f"{name} ")]
    forms = [FORMS.get(name) for name in (*sorted(own, key=len, reverse=True), cause.kind)]
    return next((form.headline for form in forms if form is not None and form.headline), None)


def table_of_causes() -> str:
    """Return the documentation's table of all forms, in Markdown."""
    priors = "parameters and their priors"
    rows: list[tuple[str, ...]] = [
        ("kind", "cause", "formula", priors, "estimates", "left out when"),
        ("---",) * 6,
    ]
    for kind in (*kinds(), _ALWAYS):
        forms = [form for form in FORMS.values() if form.kind == kind]
        for form in sorted(forms, key=lambda form: form.name != kind):
            near = f" (near: {', '.join(form.like)})" if form.like else ""
            first = f"`{kind}`{near}" if form.name == kind else ""
            rows.append((first, *form.cells))
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)
