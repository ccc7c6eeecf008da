"""What every registered cause holds, and that a new one is one file."""

from __future__ import annotations

import csv
import inspect
import os
import pickle
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from sklearn.base import clone
from tide import context_of

import hybridsurrogate as hs
from hybridsurrogate.catalogue import catalogue
from hybridsurrogate.effects import registry
from hybridsurrogate.effects.registry import (
    FORMS,
    Form,
    classes,
    kinds,
    meaning_of,
    register,
)

DOCS = Path(__file__).resolve().parents[2] / "docs"
PAGE = DOCS / "how-to" / "add_to_the_catalogue.md"


@pytest.mark.parametrize("name", classes())
def test_what_is_registered_is_exported(name):
    assert getattr(hs, name) is getattr(hs.effects, name) is classes()[name]
    assert name in hs.__all__
    assert name in hs.effects.__all__


@pytest.mark.parametrize("form", FORMS.values(), ids=lambda form: form.name)
def test_what_a_form_declares(form):
    assert form.cause.kind == form.kind
    assert form.least_rows >= 4
    assert form.least_distinct >= 2
    told = form.meaning or FORMS[form.kind].meaning
    if form.kind != "unexplained":
        names = {"output": "level", "target": "dose", "column": "t"}
        assert "{" not in told.format(**names)


@pytest.mark.parametrize("form", FORMS.values(), ids=lambda form: form.name)
def test_what_a_form_proposes(form):
    """In a simulation of two inputs, measured with a time of its own and batches."""
    # a second store is one where the logarithm of the output is measured, overdispersion of counts
    needed = {"second-store": "lognormal", "noise: overdispersed": "poisson"}
    context = context_of(likelihood=needed.get(form.name, "normal"))
    proposed = list(form.propose(context))
    # it has no states that an equation moves, no input of few values, no column from zero beside
    # and none of its parameters is at an end of its prior
    absent = form.name in ("offset: level", "missing-input: from zero", "narrow-prior")
    absent |= "inside" in form.name or form.kind == "missing-term"
    absent |= form.name == "second-store: in series"
    # compared where it is passed
    absent |= form.name in ("parameter-drift: process", "recurring-jumps")
    assert bool(proposed) != absent
    for cause in proposed:
        assert cause.kind == form.kind
        if form.trouble(cause, context):
            continue
        prepared = cause.prepare(context)
        again = pickle.loads(pickle.dumps(prepared))
        assert (again.name, again.variant) == (prepared.name, prepared.variant)
        assert clone(cause).get_params().keys() == cause.get_params().keys()
        if form.kind != "unexplained":
            assert meaning_of(prepared)


def test_the_documentation_has_a_row_for_each_form():
    text = (DOCS / "reference" / "causes.csv").read_text(encoding="utf-8")
    rows = {row["form"]: row for row in csv.DictReader(text.splitlines())}
    assert rows.keys() == FORMS.keys()
    for name, row in rows.items():
        others = {*kinds(), "unexplained"} - {FORMS[name].kind}
        assert set(row["easily taken for"].split()) <= others
        assert row["cause"]
        assert row["formula"]
        assert name != FORMS[name].kind or "the same" not in row.values()


@pytest.mark.parametrize(
    ("name", "cause", "error", "words"),
    [
        ("step", hs.Step, ValueError, "The name 'step' is that of Step: choose another"),
        ("stride", hs.Step, ValueError, "must begin with the kind of Step, 'step'"),
        ("step: other", "Step", TypeError, "needs a subclass of Cause, got 'Step'"),
    ],
)
def test_forms_that_cannot_be_registered(name, cause, error, words):
    before = dict(FORMS)
    with pytest.raises(error, match=words):
        register(Form(name, cause))
    assert before == FORMS


def test_a_file_that_is_loaded_anew_replaces_its_form(monkeypatch):
    monkeypatch.setattr(registry, "FORMS", dict(FORMS))
    anew = type("Step", (hs.Cause,), {"kind": "step", "__module__": hs.Step.__module__})
    registry.register(Form("step", anew))
    assert registry.FORMS["step"].cause is anew
    assert FORMS["step"].cause is hs.Step


@pytest.mark.parametrize(
    ("cause", "words"),
    [(hs.GrossError(2), "two measurements"), (hs.TrendSinceStart("t"), "nothing at the first")],
)
def test_a_form_of_several_words_has_its_own_meaning(cause, words):
    assert words in meaning_of(cause)


def test_every_class_that_is_exported_is_registered():
    exported = (getattr(hs, name) for name in hs.__all__)
    causes = {one for one in exported if inspect.isclass(one) and issubclass(one, hs.Cause)}
    # what is in one output, left beyond the range, or an error of the data, is no kind to find
    others = {hs.Cause, hs.InOutput, hs.Remainder, hs.SharedErrors, hs.OutputCorrelation}
    assert causes - others == set(classes().values())


def test_a_cause_of_the_users_own_may_have_a_registered_kind():
    class Late(hs.Cause):
        kind = "delay"
        target = "clock"

    assert any(type(cause) is Late for cause in catalogue(context_of(), [Late()])[0])


def test_a_cause_of_the_users_own_needs_no_registration():
    class Own(hs.Step):
        kind = "own"

    causes, _ = catalogue(context_of(), [Own("t")])
    assert any(cause.kind == "own" for cause in causes)
    assert "own" not in kinds()


STORY = """
import numpy as np
import hybridsurrogate as hs
from hybridsurrogate.effects.registry import FORMS

assert "Pulse" in hs.__all__ and "pulse" in FORMS
simulator = hs.Simulator(
    lambda t, rate: rate * t,
    inputs={"t": (0, 10)},
    parameters={"rate": hs.truncated_normal(1, 0.2, 0, 2)},
    output="level",
)
t = np.linspace(0, 10, 80)
y = 1.1 * t + np.where(t < 4, 0, 3 * np.exp(-np.maximum(t - 4, 0) / 1.5))
y += 0.2 * np.random.default_rng(0).standard_normal(80)
model = hs.PowerScaledSurrogate(simulator, surrogate=hs.ExactSurrogate(), random_state=0)
diagnosis = hs.DiscrepancyDiagnosis(model, cv=None, random_state=0).fit(t[:, None], y)
assert diagnosis.best_cause_.kind == "pulse", diagnosis.causes_.head()
assert "something is added to level, and dies away" in str(diagnosis.report(full=True))
"""


FIT = """
import numpy as np
import hybridsurrogate as hs

t = np.linspace(0, 4, 30)
fall = hs.Simulator(
    lambda t, g: 100 - g / 2 * t**2,
    inputs={"t": (0, 4)},
    parameters={"g": hs.truncated_normal(9.8, 1, 5, 15)},
)
y = 100 - 4.7 * t**2 + 0.2 * np.random.default_rng(0).laplace(size=30)
model = hs.PowerScaledSurrogate(
    fall, surrogate=hs.ExactSurrogate(), likelihood="laplace", n_draws=200, random_state=0
).fit(t[:, None], y)
assert abs(model.posterior_.named()["g"].mean() - 9.4) < 0.1
assert type(model.posterior_.likelihood) is hs.Laplace
assert hs.Plane().get_params() == {}
"""


@pytest.fixture(scope="module")
def copied(tmp_path_factory):
    """Return a folder with a copy of the package, in which the files of the page lie."""
    folder = tmp_path_factory.mktemp("copied")
    skip = shutil.ignore_patterns("__pycache__")
    shutil.copytree(Path(hs.__file__).parent, folder / "hybridsurrogate", ignore=skip)
    page = PAGE.read_text(encoding="utf-8")
    files = re.findall(r"`(hybridsurrogate/\S+\.py)`:\s+```python\n(.*?)```", page, re.S)
    assert len(files) == 3
    for path, source in files:
        assert len(source.splitlines()) <= 60
        (folder / path).write_text(source, encoding="utf-8")
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("story", [STORY, FIT], ids=["a cause", "a likelihood and a surrogate"])
def test_a_new_thing_is_one_file(copied, story):
    done = subprocess.run(
        [sys.executable, "-c", story],
        cwd=copied,
        env=os.environ | {"PYTHONPATH": str(copied)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert not done.returncode, done.stderr
