"""Rows of runs as curves on one grid of places."""

from __future__ import annotations

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline

from hybridsurrogate.numerics.linear_algebra import MAX_DENSE
from hybridsurrogate.surrogates.emulation.between_places import (
    Piece,
    between_places,
    degree_of,
)
from hybridsurrogate.surrogates.emulation.components import LEFT_OUT, Curves, principal, scatter_of
from hybridsurrogate.types import FloatArray

# rows are curves where there are so many runs at least and so many rows a run on average
MIN_CURVES, MIN_CURVE_ROWS = 8, 5
# rounds in which missing pieces of curves are filled in from the components
_MAX_ROUNDS = 10


def curves_of(X: FloatArray, omega: FloatArray, eta: FloatArray) -> Curves | None:
    """Return runs as curves, None where each row is a separate run.

    Rows with the same parameters and the same inputs but one are a run along that one.

    Parameters
    ----------
    X, omega, eta : ndarray of shape (n, n_inputs), (n, n_parameters), (n,)
        Rows of all runs, in any order.
    """
    # repeats of a run are no rows of a curve
    n_rows = int(np.sum(~pd.DataFrame(np.hstack([X, omega])).duplicated()))
    best: tuple[int, FloatArray, NDArray[np.intp]] | None = None
    for along in range(X.shape[1]):
        others, run = distinct(np.hstack([np.delete(X, along, axis=1), omega]))
        are_curves = MIN_CURVES <= len(others) <= n_rows / MIN_CURVE_ROWS
        if are_curves and (best is None or len(others) < len(best[1])):
            best = along, others, run
    if best is None:
        return None
    along, others, run = best
    places, table, interpolated = _on_one_grid(X[:, along], run, eta, len(others))
    if len(places) < MIN_CURVE_ROWS:
        return None
    column = np.searchsorted(places, X[:, along])
    # where each run has its own places none is repeated
    shared = np.array_equal(places[np.minimum(column, len(places) - 1)], X[:, along])
    own = run if shared else np.arange(len(eta))
    scatter = scatter_of(column, own, eta, len(places), others)
    whole = ~(interpolated | np.isnan(table)).any(axis=1)
    enough = np.sum(whole) >= MIN_CURVES
    pieces = [(places, table[whole])] if enough else _runs(X[:, along], run, eta)
    filled = _filled(table)
    if scatter.directions:  # it is no error of interpolation
        mean, left, size, curves = principal(filled, scatter)
        pieces = [(places, mean + left * size @ curves)]
    degree = degree_of(pieces)
    between = between_places(places, interpolated.mean(axis=0), pieces, degree)
    return Curves(along, places, others, filled, degree, between, scatter)


def distinct(rows: FloatArray) -> tuple[FloatArray, NDArray[np.intp]]:
    """Return the different rows, and which of them each is; quick where equal ones follow."""
    new = np.append(True, np.any(rows[1:] != rows[:-1], axis=1))
    first, which = np.unique(rows[new], axis=0, return_inverse=True)
    return first, which.ravel()[np.cumsum(new) - 1]


def _runs(x: FloatArray, run: NDArray[np.intp], eta: FloatArray) -> list[Piece]:
    """Return places and outputs of each run, in order."""
    order = np.lexsort((x, run))
    pieces = []
    for rows in np.split(order, np.cumsum(np.bincount(run))[:-1]):
        own, first = np.unique(x[rows], return_index=True)
        pieces.append((own, eta[rows][first][None]))
    return pieces


def _on_one_grid(
    x: FloatArray, run: NDArray[np.intp], eta: FloatArray, n_runs: int
) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """Return places (n_places,), outputs (n_runs, n_places), and which of these are interpolated.

    NaN where a run has no output. Gaps are left to the components where most runs have none: these
    know a rough curve better.
    """
    places, column = np.unique(x, return_inverse=True)
    rows_a_run = np.bincount(run, minlength=n_runs)
    if len(places) <= 2 * np.median(rows_a_run):
        flat = run * len(places) + column.ravel()
        count = np.bincount(flat, minlength=n_runs * len(places))
        total = np.bincount(flat, weights=eta, minlength=n_runs * len(places))
        with np.errstate(invalid="ignore"):
            table = (total / count).reshape(n_runs, len(places))
        gaps = np.isnan(table)
        some = np.flatnonzero(gaps.any(axis=1))
        if n_runs - len(some) < max(MIN_CURVES, n_runs // 2):
            for k in some:
                there = ~gaps[k]
                table[k] = _interpolated(places[there], table[k, there], places)
        return places, table, gaps & ~np.isnan(table)
    # each run has its own places: as many as a run has, where their quantiles are
    n = min(2 * int(np.median(rows_a_run)), MAX_DENSE)
    grid = np.unique(np.quantile(places, np.linspace(0, 1, n)))
    table = np.array([_interpolated(own, y[0], grid) for own, y in _runs(x, run, eta)])
    return grid, table, ~np.isnan(table)


def _interpolated(x: FloatArray, y: FloatArray, at: FloatArray) -> FloatArray:
    """Return y at places within its range, NaN beyond by more than half a typical step."""
    if len(x) < 2:
        return np.full(len(at), np.nan)
    degree = degree_of([(x, y[None])])
    value: FloatArray = make_interp_spline(x, y, k=degree)(np.clip(at, x[0], x[-1]))
    margin = 0.5 * float(np.median(np.diff(x)))
    value[(at < x[0] - margin) | (at > x[-1] + margin)] = np.nan
    return value


def _filled(table: FloatArray) -> FloatArray:
    """Return curves whose missing pieces are what the components make of the rest.

    The mean of the missing outputs given the others, all curves being draws of a normal
    distribution with the components' covariance; its components are those of complete curves, then
    of all as they are filled.
    """
    gaps = np.isnan(table)
    incomplete = np.flatnonzero(gaps.any(axis=1))
    if not len(incomplete):
        return table
    out = np.where(gaps, np.nanmean(table, axis=0), table)
    out = np.where(np.isnan(out), np.nanmean(table), out)
    whole = np.delete(np.arange(len(table)), incomplete)
    source = whole if len(whole) >= max(MIN_CURVES, len(table) // 2) else slice(None)
    for _ in range(_MAX_ROUNDS):
        curves = out[source]
        mean = curves.mean(axis=0)
        _, size, axes = np.linalg.svd(curves - mean, full_matrices=False)
        factor = axes.T * (size / np.sqrt(len(curves)))
        noise = (LEFT_OUT * float(np.std(curves))) ** 2
        moved = 0.0
        for k in incomplete:
            there = ~gaps[k]
            own = factor[there]
            inner = noise * np.eye(own.shape[1]) + own.T @ own
            score = np.linalg.solve(inner, own.T @ (table[k, there] - mean[there]))
            again = (mean + factor @ score)[gaps[k]]
            moved = max(moved, float(np.max(np.abs(again - out[k, gaps[k]]))))
            out[k, gaps[k]] = again
        if moved < LEFT_OUT * float(np.std(out)):
            break
        source = slice(None)
    return out
