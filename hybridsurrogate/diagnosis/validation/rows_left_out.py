"""Gross errors that a search detected: which rows an extended model leaves out."""

from __future__ import annotations

from collections.abc import Sequence

from hybridsurrogate.diagnosis.search.candidate import Candidate
from hybridsurrogate.diagnosis.search.forward_selection import SearchStep
from hybridsurrogate.diagnosis.search.local_prediction import local_posterior, measured_and_other
from hybridsurrogate.diagnosis.search.search import Search
from hybridsurrogate.effects.base import Cause
from hybridsurrogate.effects.noise.gross_error import GrossError, GrossRow


def with_rows(causes: Sequence[Cause], steps: Sequence[SearchStep]) -> tuple[Cause, ...]:
    """Return causes in which a `GrossError` has the detected rows; others are as they are.

    Parameters
    ----------
    causes : sequence of Cause
        Of the searches.
    steps : sequence of SearchStep

    Examples
    --------
    >>> import hybridsurrogate as hs
    >>> causes = (hs.Offset(),)
    >>> with_rows(causes, []) == causes
    True
    """
    return tuple(
        _found(cause, steps) if isinstance(cause, GrossError) else cause for cause in causes
    )


def _found(cause: GrossError, steps: Sequence[SearchStep]) -> Cause:
    for step in steps:
        for search in (step.conditional, step.search):
            for w in search.candidates:
                if w.cause is cause:
                    return cause.filled(rows=excluded_rows(search, w))
    return cause


def excluded_rows(search: Search, w: Candidate) -> tuple[GrossRow, ...]:
    """Return the rows that are unlike the others, with what all others predict there.

    Parameters
    ----------
    search : Search
    w : Candidate
        Of its candidates, with a `GrossError`.
    """
    cause, problem = w.cause, search.problem
    assert isinstance(cause, GrossError)
    positions = cause.at(float(w.fit.grid.points[w.fit.mode.node, 0]))
    rows, _ = measured_and_other(search, w, problem.X[:0])
    local = local_posterior(search, w, rows, float(search.sizes[-1]))
    simulation = slice(0, rows.first)
    design = rows.design[positions, simulation]
    eta = rows.offset[positions] + design @ local.mean[simulation]
    predicted = problem.likelihood.inverse(eta)
    columns = problem.model.columns
    return tuple(
        GrossRow(
            int(i) + 1,
            tuple(zip(columns, problem.X[i, : len(columns)].tolist(), strict=True)),
            float(problem.observed[i]),
            float(predicted[k]),
        )
        for k, i in enumerate(positions)
    )
