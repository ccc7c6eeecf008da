"""Commands about a surrogate on two data sources: fit, predict, choose-beta."""

from __future__ import annotations

import argparse
from typing import Any

import pandas as pd

from hybridsurrogate.command_line.output import (
    check_outputs,
    print_table,
    show,
    stage,
    write_files,
)
from hybridsurrogate.command_line.study import (
    check_file_columns,
    limits_in,
    model_of,
    read_study_data,
)
from hybridsurrogate.command_line.user_code import read_saved
from hybridsurrogate.diagnosis import DiscrepancyDiagnosis
from hybridsurrogate.diagnosis.report.summary import plain
from hybridsurrogate.estimators import choose_beta as held_out
from hybridsurrogate.estimators.beta_path import LEAVE_FUTURE_OUT
from hybridsurrogate.simulation.simulator import Simulator
from hybridsurrogate.simulation.table_file import numbers_of, read_table


def fit(given: argparse.Namespace) -> int:
    """Fit a surrogate to runs and measurements; return the exit code."""
    check_outputs(given)
    study = read_study_data(given)
    model = model_of(study, given, given.beta, given.method)
    with stage("Fit", given):
        model.fit(study.X, study.y, y_err=study.y_err)
    table = model.summary()
    numbers = {"estimates": plain(table.reset_index(names="name"))}
    files = write_files(given, numbers, saved=model, code=study.code)
    show(given, _text(table), numbers, *files)
    return 0


def choose_beta(given: argparse.Namespace) -> int:
    """Choose the weight of the simulation by held-out rows; return the exit code."""
    check_outputs(given)
    study = read_study_data(given)
    if isinstance(study.simulation, Simulator):
        raise ValueError(
            "A function that is run itself has no weight to choose: add --runs 128, and it is "
            "emulated."
        )
    cv = LEAVE_FUTURE_OUT if given.future else given.folds
    # every weight that is tried takes the place of the first
    model = model_of(study, given, 0.5, given.method)
    with stage("Folds", given):
        choice = held_out(model, study.X, study.y, given.betas, cv, y_err=study.y_err)
    text = f"beta = {choice.beta:g} has the best held-out ELPD.\n\n{_text(choice.table)}"
    numbers = {"beta": choice.beta, "table": plain(choice.table)}
    files = write_files(given, numbers, saved=choice.estimator, code=study.code)
    show(given, text, numbers, *files)
    return 0


def predict(given: argparse.Namespace) -> int:
    """Predict from what was saved; return the exit code."""
    check_outputs(given)
    saved: Any = read_saved(given.saved)
    model = saved.extended_estimator_ if isinstance(saved, DiscrepancyDiagnosis) else saved
    new = read_table(given.new_inputs)
    rows = _rows_for(model, new, given.new_inputs)
    below, above, _ = limits_in(new, given.new_inputs, given)
    known = rows if hasattr(model, "feature_names_in_") else rows.to_numpy()
    mean, sd = model.predict(known, return_std=True)
    low, high = model.predict_interval(known, 0.9, below=below, above=above)
    outputs = model.simulation.outputs
    table = rows.copy()
    for k, name in enumerate(outputs):
        for word, values in (("mean", mean), ("sd", sd), ("low", low), ("high", high)):
            table[f"{name}_{word}"] = values if len(outputs) == 1 else values[:, k]
    print_table(table, given)
    return 0


def _rows_for(model: Any, table: pd.DataFrame, path: str) -> pd.DataFrame:
    """Return the columns that a fitted model has, as numbers."""
    # of rows that came as arrays the simulation's inputs alone have names
    names = list(getattr(model, "feature_names_in_", model.simulation.input_names))
    if len(names) < model.n_features_in_:
        raise ValueError(
            "It was fitted to an array of more columns than the simulation has inputs, and these "
            "have no names: fit it to a DataFrame."
        )
    check_file_columns(names, table, path)
    label = model.experiment
    return pd.DataFrame(
        {name: table[name] if name == label else numbers_of(table[name], path) for name in names}
    )


def _text(table: pd.DataFrame) -> str:
    return str(table.to_string(float_format=lambda value: f"{value:.4g}"))
