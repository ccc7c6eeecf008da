"""Fits and diagnoses keep the linear algebra to one thread, and give the others back."""

from __future__ import annotations

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.fitting import diagnose
from hybridsurrogate.inference import procedure as fitting


def threads():
    """Return how many threads each BLAS has."""
    return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}


@pytest.fixture
def two_threads():
    with threadpool_limits(2, user_api="blas"):
        if threads() != {2}:
            pytest.skip("this BLAS has one thread only")
        yield
        assert threads() == {2}


def noted(monkeypatch, module, name):
    """Return a list of what `threads` is whenever a function of a module is called."""
    seen, function = [], getattr(module, name)

    def call(*arguments, **named):
        seen.append(threads())
        return function(*arguments, **named)

    monkeypatch.setattr(module, name, call)
    return seen


@pytest.mark.usefixtures("two_threads")
def test_a_fit_has_one_thread(simulation, measured, monkeypatch):
    seen = noted(monkeypatch, fitting, "make_target")
    hs.PowerScaledSurrogate(simulation, n_draws=20, random_state=0).fit(*measured)
    assert seen == [{1}]


@pytest.mark.slow
@pytest.mark.usefixtures("two_threads")
def test_a_diagnosis_has_one_thread(simulator, measured, monkeypatch):
    searches = noted(monkeypatch, diagnose, "forward_search")
    folds = noted(monkeypatch, diagnose, "cross_validated")
    model = hs.PowerScaledSurrogate(simulator, surrogate=hs.ExactSurrogate(), n_draws=20)
    hs.DiscrepancyDiagnosis(model, cv=2, n_replicates=19, random_state=0).fit(*measured)
    assert searches == [{1}]
    assert folds == [{1}]
