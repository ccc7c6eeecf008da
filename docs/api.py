"""The page of all public names, by task."""

from __future__ import annotations

from collections.abc import Iterator

import hybridsurrogate as hs
from hybridsurrogate import datasets, plotting, scoring
from hybridsurrogate.effects.registry import classes
from hybridsurrogate.likelihoods import LIKELIHOODS
from hybridsurrogate.surrogates import SURROGATES

# a task, and the names for it; what registers itself is added below
TASKS = {
    "Describe a simulation": (
        *("Simulator", "OdeSimulator", "CommandSimulator", "Assumed", "truncated_normal"),
    ),
    "Read and hold runs": ("SimulationData", "read_simulation"),
    "Emulate a simulation": ("Emulator",),
    "Find out what is wrong": ("DiscrepancyDiagnosis", "CauseFinding", "refine"),
    "Compare simulations": ("compare_simulations", "SimulationComparison"),
    "Plan measurements": ("detectability", "Detectability"),
    "Fit and predict": (
        *("PowerScaledSurrogate", "PredictiveWeightedSurrogate", "MultiSourceSurrogate", "Source"),
        *("SharedErrors", "OutputCorrelation"),
        *("KennedyOHaganSurrogate", "AveragedSurrogate", "EnsembleSampler"),
    ),
    "Choose beta": ("choose_beta", "beta_path"),
    "Save and load": ("save", "load"),
    "See which parameters matter": ("sobol_indices",),
    "Write a cause": ("Cause", "InOutput", "SIMULATED", "SLOPE"),
}


# rooms whose functions and classes are listed as they are
ROOMS = {"Score predictions": scoring, "Draw": plotting, "Load data sets": datasets}


def _names() -> Iterator[tuple[str, list[str]]]:
    warnings = {name for name in hs.__all__ if name.endswith("Warning")}
    registered = {
        "Causes": set(classes()) | {"Remainder"},
        "Surrogates": {type(one).__name__ for one in SURROGATES.values()},
        "Likelihoods": {type(one).__name__ for one in LIKELIHOODS.values()}
        | {"Censored", "CustomLikelihood"},
        "Warnings": warnings,
    }
    listed: set[str] = set()
    for task, names in (*TASKS.items(), *registered.items()):
        public = [name for name in names if name in hs.__all__]
        listed |= set(public)
        yield task, public if task in TASKS else sorted(public)
    rest = sorted(set(hs.__all__) - listed)
    if rest:
        yield "More", rest


def page_of_names() -> str:
    """Return the page as reStructuredText."""
    title = "API by task"
    lines = [title, "=" * len(title), "", ".. currentmodule:: hybridsurrogate", ""]
    for task, names in _names():
        lines += [task, "-" * len(task), "", ".. autosummary::", "   :toctree: generated", ""]
        lines += [*(f"   {name}" for name in names), ""]
    for task, room in ROOMS.items():
        lines += [task, "-" * len(task), "", f".. currentmodule:: {room.__name__}", ""]
        lines += [".. autosummary::", "   :toctree: generated", ""]
        # colours are callable, too
        names = [name for name in sorted(room.__all__) if not name.isupper()]
        lines += [*(f"   {name}" for name in names), ""]
    return "\n".join(lines)
