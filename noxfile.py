"""Sessions for nox: the suite on every Python that the package supports, style and types, pages."""

import nox

PYTHONS = ["3.11", "3.12", "3.13"]


@nox.session(python=PYTHONS)
def tests(session):
    """Run the suite."""
    session.install(".[test]")
    session.run("python", "-m", "pytest", "-n", "auto", *session.posargs)


@nox.session
def slow(session):
    """Run the whole stories and the rates over many seeds."""
    session.install(".[test]")
    session.run("python", "-m", "pytest", "-n", "auto", "-m", "slow", *session.posargs)


@nox.session
def style(session):
    """Check style and types."""
    session.install("-e", ".[test]")
    session.run("ruff", "check", ".")
    session.run("ruff", "format", "--check", ".")
    session.run("mypy")


@nox.session
def pages(session):
    """Build the documentation."""
    session.install(".[docs]")
    session.run("python", "-m", "sphinx", "docs", "docs/_build")
