#!/usr/bin/env -S uv run --script
# /// script
# dependencies = ["nox>=2025.2.9"]
# ///
"""Sessions for nox: the suite, lowest dependencies, style and types, pages, what is released."""

import tempfile
from pathlib import Path

import nox

nox.needs_version = ">=2025.2.9"
nox.options.default_venv_backend = "uv|virtualenv"
PYTHONS = ["3.11", "3.12", "3.13", "3.14"]
# what a lower bound may break: tables, pictures, samplers, ArviZ, scikit-learn's checks
QUICK = [
    *("tests/estimators", "tests/likelihoods", "tests/plotting", "tests/simulation"),
    *("tests/surrogates", "tests/scoring", "tests/command_line", "tests/test_posterior.py"),
    *("tests/test_priors.py", "tests/house/test_sklearn_contract.py"),
]


@nox.session(python=PYTHONS)
def tests(session: nox.Session) -> None:
    """Run the suite with the newest dependencies."""
    session.install("--upgrade", ".[test]")
    session.run("python", "-m", "pytest", "-n", "auto", *session.posargs)


@nox.session(python="3.11")
def lowest(session: nox.Session) -> None:
    """Run a part of the suite with the lowest dependencies that pyproject.toml allows."""
    project = nox.project.load_toml("pyproject.toml")["project"]
    bounds = project["dependencies"] + project["optional-dependencies"]["test"]
    # tools of the tests need not be old
    tools = ("pytest", "ruff", "mypy")
    pins = [bound.replace(">=", "==") for bound in bounds if not bound.startswith(tools)]
    session.install(".", *pins, "pytest>=8.2", "pytest-benchmark>=4", "pytest-xdist>=3.5")
    # old packages warn of newer ones
    quiet = ("-o", "filterwarnings=default")
    session.run("python", "-m", "pytest", "-n", "auto", *quiet, *(session.posargs or QUICK))


@nox.session
def slow(session: nox.Session) -> None:
    """Run the whole stories and the rates over many seeds."""
    session.install(".[test]")
    session.run("python", "-m", "pytest", "-n", "auto", "-m", "slow", *session.posargs)


@nox.session
def style(session: nox.Session) -> None:
    """Check style and types."""
    session.install("-e", ".[test]")
    session.run("ruff", "check", ".")
    session.run("ruff", "format", "--check", ".")
    session.run("mypy")


@nox.session
def review(session: nox.Session) -> None:
    """Compare the repository with the guide of Scientific Python."""
    session.install("sp-repo-review[cli]")
    session.run("repo-review", ".")


@nox.session
def pages(session: nox.Session) -> None:
    """Build the documentation."""
    session.install(".[docs]")
    session.run("python", "-m", "sphinx", "docs", "docs/_build")


@nox.session
def dist(session: nox.Session) -> None:
    """Build what is released, check it, and use both of it in empty environments."""
    session.install("build>=1.2", "twine>=6.1")
    # not the folder `build`, which would hide the module
    made = Path(session.create_tmp(), "dist").resolve()
    session.run("python", "-m", "build", "--outdir", str(made), silent=True)
    artefacts = sorted(made.glob("hybridsurrogate-*"))[-2:]
    session.run("python", "-m", "twine", "check", "--strict", *map(str, artefacts))
    script = Path("tests", "helpers", "small_diagnosis.py").resolve()
    for artefact in artefacts:
        with tempfile.TemporaryDirectory() as folder, session.chdir(folder):
            session.run("python", "-m", "venv", "empty", silent=True)
            session.run("empty/bin/pip", "install", "-q", str(artefact), external=True)
            session.run("empty/bin/hybridsurrogate", "demo", "--list", external=True)
            session.run("empty/bin/python", str(script), external=True)


if __name__ == "__main__":
    nox.main()
