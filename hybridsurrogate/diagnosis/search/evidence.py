"""How well each cause explains the measured rows: closed-form evidence, and probabilities.

The surrogate's coefficients come from the simulation alone (beta = 1), so that a fault of the
simulation is not absorbed by its emulator; the emulator's own uncertainty is part of the
covariance (DESIGN section 6).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy import special

from hybridsurrogate.diagnosis.search.conditioning import nothing_further
from hybridsurrogate.diagnosis.search.local_fit import (
    Fitted,
    InterruptedSearch,
    best_null,
    effect_sizes,
    node_evidence,
)
from hybridsurrogate.diagnosis.search.screening import best_modes
from hybridsurrogate.effects.base import Cause
from hybridsurrogate.inference.conjugate.emulator_posterior import EmulatorPosterior
from hybridsurrogate.inference.conjugate.noise_marginal import KnownNoise, LogMarginal, NoiseTable
from hybridsurrogate.inference.evidence.grid import Grid, make_grid
from hybridsurrogate.inference.evidence.linearised import linearise
from hybridsurrogate.inference.evidence.marginal_likelihood import LocalMode, scan
from hybridsurrogate.inference.evidence.outliers import settled
from hybridsurrogate.inference.evidence.settings import SETTINGS
from hybridsurrogate.inference.model.observation import MeasuredModel
from hybridsurrogate.priors import FloatArray
from hybridsurrogate.problem.problem import Problem

_VERDICTS = {"none": "adequate", "unexplained": "unexplained"}


class Candidate(NamedTuple):
    """One cause (None: nothing is wrong) at its best, with its evidence."""

    cause: Cause | None
    model: MeasuredModel
    grid: Grid
    mode: LocalMode
    sigma: float
    log_evidence: float
    log_evidence_with_remainder: float


@dataclass(frozen=True)
class Search:
    """A finished search over the catalogue.

    Attributes
    ----------
    problem : Problem
    emulator : EmulatorPosterior
        About the surrogate's coefficients, from the simulation alone.
    candidates : list of Candidate
        "None" first, then the causes in the order of the catalogue.
    probability : ndarray
        Posterior probability of each.
    remainder : ndarray
        Probability that a smooth remainder is needed beside each cause.
    sizes : ndarray
        Prior scales of effect sizes, in units of eta.
    noise : LogMarginal
        Sigma integrated out under the problem's prior.
    """

    problem: Problem
    emulator: EmulatorPosterior
    candidates: list[Candidate]
    probability: FloatArray
    remainder: FloatArray
    sizes: FloatArray
    noise: LogMarginal


def search(
    problem: Problem,
    causes: Sequence[Cause],
    emulator: EmulatorPosterior,
    with_remainder: bool = True,
    accepted: Candidate | None = None,
    nearby: Search | None = None,
) -> Search:
    """Weigh "nothing is wrong" and every cause.

    Parameters
    ----------
    problem : Problem
        Without effects, or with those that an earlier search accepted.
    causes : sequence of Cause
        Prepared.
    emulator : EmulatorPosterior
        About the surrogate's coefficients, from the simulation alone.
    with_remainder : bool
        Also weigh the winners beside a smooth remainder of unknown shape.
    accepted : Candidate or None
        The last of the problem's effects as it was found, in place of "nothing is wrong".
    nearby : Search or None
        The search over the same causes in other rows of the same data: only what is promising there
        is optimised, from where it ended there. Grids are searched anew, but an optimisation may
        keep to its hill.

    Raises
    ------
    InterruptedSearch
        On an interrupt: it holds the search over the causes that were fitted by then.
    """
    problem = replace(problem, model=replace(problem.model, reference=emulator.mean))
    n = len(problem.y)
    noise = (
        KnownNoise(n)
        if problem.noise_is_known
        else NoiseTable(problem.noise_prior, problem.scale, n)
    )
    if accepted is None:
        null = best_null(problem, emulator, noise)
    else:
        null = nothing_further(problem, Fitted(*accepted[1:5]), emulator, noise)
    ends = _ends_of(nearby, problem, causes)
    odds = prior_odds([None, *causes])
    fits: Sequence[Fitted] = []
    try:
        fits, behind = best_modes(problem, causes, emulator, noise, null, np.log(odds), ends)
        known = np.append(np.nan, behind)
        return _weigh(problem, causes, emulator, noise, [null, *fits], known, with_remainder)
    except KeyboardInterrupt as stop:
        kept = [null, *(stop.kept if isinstance(stop, InterruptedSearch) else fits)]
        unknown = np.full(len(kept), np.nan)
        candidates = _weigh(problem, causes, emulator, noise, kept, unknown, False)
        raise InterruptedSearch(candidates) from stop


def _weigh(
    problem: Problem,
    causes: Sequence[Cause],
    emulator: EmulatorPosterior,
    noise: LogMarginal,
    modes: Sequence[Fitted],
    known: FloatArray,
    with_remainder: bool,
) -> Search:
    """Weigh "nothing is wrong" and the first so many causes at their best fits.

    ``known`` is the log evidence where it is known well enough already, NaN elsewhere.
    """
    sizes = effect_sizes(problem, modes)
    candidates = []
    for cause, fit, evidence in zip([None, *causes], modes, known, strict=False):
        if np.isnan(evidence):
            evidence = np.logaddexp.reduce(node_evidence(problem, emulator, noise, fit, sizes))
        candidates.append(Candidate(cause, *fit, float(evidence), -np.inf))
    probability, remainder = probabilities(candidates)
    quick = Search(problem, emulator, candidates, probability, remainder, sizes, noise)
    return remainders(quick) if with_remainder else quick


def remainders(result: Search) -> Search:
    """Return the search with its winners also weighed beside a smooth remainder."""
    candidates = _weigh_remainder(
        result.problem, result.emulator, result.noise, result.candidates, result.sizes
    )
    probability, remainder = probabilities(candidates)
    return replace(result, candidates=candidates, probability=probability, remainder=remainder)


def _ends_of(
    nearby: Search | None, problem: Problem, causes: Sequence[Cause]
) -> list[Fitted] | None:
    """Return where the same causes ended; None where it weighed other causes."""
    if nearby is None:
        return None
    known = nearby.candidates[1:]
    # other rows may lack an experiment, which has a number of its own
    unknowns = [(c.name, *c.parameters) for c in causes]
    if unknowns != [(w.cause.name, *w.cause.parameters) for w in known if w.cause is not None]:
        return None
    if nearby.problem.model.theta_names != problem.model.theta_names:
        return None
    return [Fitted(*w[1:5]) for w in known]


def _weigh_remainder(
    problem: Problem,
    emulator: EmulatorPosterior,
    noise: LogMarginal,
    candidates: list[Candidate],
    sizes: FloatArray,
) -> list[Candidate]:
    """Weigh the winners of the quick search beside a smooth discrepancy of unknown shape."""
    quick, _ = probabilities(candidates)
    # of several outputs a curve in the one that needs it most
    processes = [w for w in candidates if kind_of(w) == "unexplained"]
    process = max(processes, key=lambda w: w.log_evidence, default=None)
    if process is None:
        return candidates
    model, lengths = process.model, make_grid(process.model)
    values = np.repeat(model.values(np.zeros((1, model.n_unknowns))), len(lengths.points), axis=0)
    values[:, lengths.nodes] = lengths.points
    own = [owner == len(model.effects) - 1 for owner, _ in model.column_names]
    bases = model.added(problem.X, values)[:, :, own]
    bases = bases / np.sqrt(np.mean(np.sum(bases**2, axis=2), axis=1))[:, None, None]
    named = [k for k, w in enumerate(candidates) if kind_of(w) not in ("none", "unexplained")]
    best = max(named, key=lambda k: quick[k], default=None)
    out = []
    for k, (w, probability) in enumerate(zip(candidates, quick, strict=True)):
        # the best named cause always has its chance: data usually hold more than one wrong thing
        if w is process or (probability < 0.01 and w.cause is not None and k != best):
            out.append(w)
            continue
        if w.cause is None:
            out.append(w._replace(log_evidence_with_remainder=process.log_evidence))
            continue
        parts = linearise(w.model, problem.X, emulator, w.grid, w.mode.z)
        nodes = scan(parts, problem.y[None], w.sigma, noise, sizes)[0]
        # zero but for causes that were placed together, whose evidence is not that of the last one
        beyond_last = w.log_evidence - float(special.logsumexp(nodes))
        best_first = np.argsort(-nodes)
        parts = parts.at(best_first[nodes[best_first] > nodes.max() - 10.0])
        beyond_node = 0.0
        if parts.noise_differs:
            # every node would need its own factorisation: the best one tells what a curve adds
            parts = settled(parts, problem.y, w.sigma)
            plain = scan(parts, problem.y[None], w.sigma, noise, sizes)[0]
            beyond_node = float(special.logsumexp(nodes)) - float(plain[0])
        terms = [
            np.logaddexp.reduce(
                scan(
                    replace(parts, U=np.hstack([parts.U, size * basis])),
                    problem.y[None],
                    w.sigma,
                    noise,
                    sizes,
                )[0]
            )
            for basis in bases
            for size in sizes[::2]
        ]
        total = float(np.logaddexp.reduce(terms) - np.log(len(terms)))
        total += beyond_node + beyond_last
        out.append(w._replace(log_evidence_with_remainder=total))
    return out


def prior_odds(causes: Sequence[Cause | None]) -> FloatArray:
    """Return the prior probability of each cause, None for nothing that is wrong.

    Kinds share the prior equally, the forms of a kind share that of their kind, and causes that
    differ only in the level that is meant share that of one form.
    """
    kinds = ["none" if cause is None else cause.kind for cause in causes]
    forms = [
        (kind, cause.target if cause is not None and cause.is_one_level else k)
        for k, (kind, cause) in enumerate(zip(kinds, causes, strict=True))
    ]
    of_kind = Counter(kind for kind, _ in set(forms))
    of_form = Counter(forms)
    fixed = {"none": SETTINGS.prior_none, "unexplained": SETTINGS.prior_unexplained}
    share = (1 - sum(fixed.values())) / max(len(of_kind.keys() - fixed.keys()), 1)
    return np.array(
        [
            fixed.get(kind) or share / of_kind[kind] / of_form[form]
            for kind, form in zip(kinds, forms, strict=True)
        ]
    )


def probabilities(candidates: Sequence[Candidate]) -> tuple[FloatArray, FloatArray]:
    """Return the posterior probability of each cause, and that of a remainder beside it."""
    alone = np.array([w.log_evidence for w in candidates])
    with_remainder = np.array([w.log_evidence_with_remainder for w in candidates])
    # "none" with a remainder is "unexplained", which is weighed on its own
    splits = np.isfinite(with_remainder) & np.array([w.cause is not None for w in candidates])
    with np.errstate(divide="ignore"):
        plain = alone + np.where(splits, np.log1p(-SETTINGS.prior_remainder), 0.0)
        extra = np.where(splits, with_remainder + np.log(SETTINGS.prior_remainder), -np.inf)
    log_total = np.logaddexp(plain, extra) + np.log(prior_odds([w.cause for w in candidates]))
    remainder = np.exp(extra - np.logaddexp(plain, extra))
    return np.exp(log_total - special.logsumexp(log_total)), remainder


def kind_of(candidate: Candidate) -> str:
    """Return the kind of a weighed cause, "none" for the null."""
    return "none" if candidate.cause is None else candidate.cause.kind


def leader(result: Search) -> int:
    """Return the position of the most probable cause other than "none", by kind then target."""
    shares = kind_shares(result)
    kind = max(shares, key=lambda name: shares[name])
    member = [k for k, w in enumerate(result.candidates) if kind_of(w) == kind]
    return max(member, key=lambda k: result.probability[k])


def kind_shares(result: Search) -> dict[str, float]:
    """Return the probability of each kind, given that something is wrong."""
    shares: dict[str, float] = {}
    for w, probability in zip(result.candidates[1:], result.probability[1:], strict=True):
        shares[kind_of(w)] = shares.get(kind_of(w), 0.0) + float(probability)
    total = sum(shares.values())
    return {kind: value / total for kind, value in shares.items()} if total else shares


def verdict_on(chosen: Candidate, result: Search) -> str:
    """Return the verdict, given what the search chose."""
    kind = kind_of(chosen)
    if kind in _VERDICTS:
        return _VERDICTS[kind]
    return "named" if kind_shares(result)[kind] >= SETTINGS.named else "ambiguous"


def credible_kinds(result: Search) -> list[str]:
    """Return the kinds that together reach 90 % probability, most probable first."""
    kinds, mass = [], 0.0
    for kind, share in sorted(kind_shares(result).items(), key=lambda item: -item[1]):
        kinds.append(kind)
        mass += share
        if mass >= SETTINGS.set_mass:
            break
    return kinds
