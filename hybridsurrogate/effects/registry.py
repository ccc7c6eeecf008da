"""The registry of causes: each class of effects/ registers its forms.

A new cause is one class in a room of effects/: it is imported, exported, proposed to every
diagnosis, shown in reports and listed in the documentation because it registers itself.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

from hybridsurrogate.effects.base import Cause, Context
from hybridsurrogate.registration import add, import_all

# what may not be excluded: a curve of any shape is always compared
_ALWAYS = "unexplained"
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

    @property
    def kind(self) -> str:
        """The word by which reports call the kind."""
        return self.name.partition(": ")[0]


FORMS: dict[str, Form] = {}


def register(*forms: Form) -> None:
    """Make forms part of the catalogue.

    Raises
    ------
    TypeError
        For a form of something else than a class of causes.
    ValueError
        If its name begins with another word than the kind of its class, or is taken.
    """
    for form in forms:
        cause = form.cause
        if not (isinstance(cause, type) and issubclass(cause, Cause)):
            raise TypeError(f"Form({form.name!r}, ...) needs a subclass of Cause, got {cause!r}.")
        if form.kind != cause.kind:
            raise ValueError(
                f"Form({form.name!r}, ...) must begin with the kind of {cause.__name__}, "
                f"{cause.kind!r}, and may go on with ': ' and a word for the form."
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


def over_ignored(make: Callable[[str], Cause]) -> Callable[[Context], Iterator[Cause]]:
    """Return what proposes one cause for each column that the simulation ignores, of labels too."""
    return lambda context: (make(column) for column in context.ignored)


def over_columns(make: Callable[[str], Cause]) -> Callable[[Context], Iterator[Cause]]:
    """Return what proposes one cause for each measured column that is an axis."""
    return lambda context: (make(column) for column in (*context.inputs, *context.extras))


def needs(
    what: Callable[[Context], object], reason: str
) -> Callable[[Context], list[tuple[None, str]]]:
    """Return what says why nothing is proposed where the context lacks something."""
    return lambda context: [] if what(context) else [(None, reason)]


WITHOUT_LABELS = needs(
    lambda context: context.labels, "no column labels experiments; experiment=... declares one"
)


def meaning_of(cause: Cause) -> str | None:
    """Return what a cause means, in words with places for names; None where nothing is known."""
    return cause.meaning or next((form.meaning for form in _forms_of(cause) if form.meaning), None)


def headline_of(cause: Cause) -> str | None:
    """Return the first sentence of a report about a cause, with places for names and estimates."""
    return next((form.headline for form in _forms_of(cause) if form.headline), None)


def _forms_of(cause: Cause) -> list[Form]:
    """Return the forms that a cause may be of, the one with the longest name first."""
    whole = f"{cause.kind}: {cause.variant} "
    names = [name for name in FORMS if name == cause.kind or whole.startswith(f"{name} ")]
    return [FORMS[name] for name in sorted(names, key=len, reverse=True)]
