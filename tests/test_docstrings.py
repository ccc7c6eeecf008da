"""The examples of every docstring run and print what they say."""

import doctest
import importlib
import pkgutil

import pytest

import hybridsurrogate

MODULES = [m.name for m in pkgutil.walk_packages(hybridsurrogate.__path__, "hybridsurrogate.")]


@pytest.mark.parametrize("name", MODULES)
def test_examples_run(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # some write a file
    assert doctest.testmod(importlib.import_module(name)).failed == 0


def test_examples_are_many():
    finder = doctest.DocTestFinder(exclude_empty=True)
    found = [
        test
        for name in MODULES
        for test in finder.find(importlib.import_module(name))
        if test.examples
    ]
    assert len(found) > 50
