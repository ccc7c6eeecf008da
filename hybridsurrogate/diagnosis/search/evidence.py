"""How well each cause explains the measured rows: closed-form evidence, and probabilities.

The surrogate's coefficients come from the simulation alone (beta = 1), so that a fault of the
simulation is not absorbed by its emulator; the emulator's uncertainty is part of the
covariance (Kennedy and O'Hagan 2001, Journal of the Royal Statistical Society B 63:425).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
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
from hybridsurrogate.inference.conjugate.noise_marginal import KnownNoise, LogMarginal, NoiseTable
from hybridsurrogate.inference.evidence.grid import Grid, make_grid
from hybridsurrogate.inference.evidence.linearised import Linearised, linearise
from hybridsurrogate.inference.evidence.marginal_likelihood import (
    LocalMode,
    scan,
    scan_with_process,
)
from hybridsurrogate.inference.evidence.outliers import settled
from hybridsurrogate.inference.evidence.settings import SETTINGS
from hybridsurrogate.model.observation import MeasuredModel
from hybridsurrogate.model.problem import Problem
from hybridsurrogate.model.statistics import EmulatorPosterior
from hybridsurrogate.types import FloatArray

_VERDICTS = {"none": "adequate", "unexplained": "unexplained"}
# probability of a cause together with correlated noise
_MATTERS = 0.01


class Candidate(NamedTuple):
    """One cause (None: nothing is wrong) at its best, with its evidence."""

    cause: Cause | None
    model: MeasuredModel
    grid: Grid
    mode: LocalMode
    sigma: float
    log_evidence: float
    log_evidence_with_remainder: float = -np.inf
    log_evidence_with_noise: float = -np.inf

    def __repr__(self) -> str:
        name = "none" if self.cause is None else f"{self.cause.name}: {self.cause.variant}"
        return f"Candidate({name.removesuffix(': ')}, log_evidence={self.log_evidence:.2f})"


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
        Probability that a smooth remainder is needed in addition to each cause.
    correlated : ndarray
        Probability that, given each cause, the noise of neighbouring rows is correlated.
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
    correlated: FloatArray
    sizes: FloatArray
    noise: LogMarginal

    def __repr__(self) -> str:
        order = np.argsort(-self.probability)[:3]
        best = ", ".join(f"{kind_of(self.candidates[k])} {self.probability[k]:.2f}" for k in order)
        rows = len(self.problem.y)
        return f"Search({len(self.candidates)} candidates on {rows} rows; {best})"

    def reweighed(self, candidates: list[Candidate]) -> Search:
        """Return the search with other evidence for its candidates."""
        probability, remainder, correlated = probabilities(candidates)
        return replace(
            self,
            candidates=candidates,
            probability=probability,
            remainder=remainder,
            correlated=correlated,
        )


def search(
    problem: Problem,
    causes: Sequence[Cause],
    emulator: EmulatorPosterior,
    with_remainder: bool = True,
    accepted: Candidate | None = None,
    nearby: Search | None = None,
) -> Search:
    """Compare "nothing is wrong" and every cause.

    Parameters
    ----------
    problem : Problem
        Without effects, or with those that an earlier search accepted.
    causes : sequence of Cause
        Prepared.
    emulator : EmulatorPosterior
        About the surrogate's coefficients, from the simulation alone.
    with_remainder : bool
        Also compare the winners given a smooth remainder of unknown shape.
    accepted : Candidate or None
        The last of the problem's effects as it was fitted, in place of "nothing is wrong".
    nearby : Search or None
        The search over the same causes in other rows of the same data: only what is promising there
        is optimised, from where it ended there. Grids are searched anew, but an optimisation may
        keep to its hill.

    Raises
    ------
    InterruptedSearch
        On an interrupt: it contains the search over the causes that were fitted by then.
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
    whole = None if ends is None else nearby
    compared = np.arange(len(causes)) if whole is None else _within_reach(whole, causes)
    some = [causes[k] for k in compared]
    log_prior = np.log(prior_odds([None, *causes]))[[0, *(1 + compared)]]
    fits: Sequence[Fitted] = []
    try:
        near = None if ends is None else [ends[k] for k in compared]
        fits, behind = best_modes(problem, some, emulator, noise, null, log_prior, near)
        every, known = list(ends or fits), np.full(1 + len(causes), -np.inf)
        for k, fit in zip(compared, fits, strict=True):
            every[k] = fit
        known[0], known[1 + compared] = np.nan, behind
        quick = _compare(problem, causes, emulator, noise, [null, *every], known)
        # given an accepted cause a quick search is for a second one, which may be noise itself
        if accepted is not None and not with_remainder:
            return quick
        return with_processes(quick, with_remainder, whole)
    except KeyboardInterrupt as stop:
        kept = [null, *(stop.kept if isinstance(stop, InterruptedSearch) else fits)]
        unknown = np.full(len(kept), np.nan)
        candidates = _compare(problem, some, emulator, noise, kept, unknown)
        raise InterruptedSearch(candidates) from stop


def _within_reach(nearby: Search, causes: Sequence[Cause]) -> NDArray[np.intp]:
    """Return the causes that may explain some of the rows best, given a search in all of them.

    Processes are always compared: what has no other explanation in few rows is theirs.
    """
    with np.errstate(divide="ignore"):
        log_share = np.log(nearby.probability[1:])
    best = np.max(log_share, initial=-np.inf)
    always = np.array([cause.is_process or cause.is_correlated_noise for cause in causes])
    return np.flatnonzero(always | (log_share > best - SETTINGS.pruned_nearby))


def _compare(
    problem: Problem,
    causes: Sequence[Cause],
    emulator: EmulatorPosterior,
    noise: LogMarginal,
    modes: Sequence[Fitted],
    known: FloatArray,
) -> Search:
    """Compare "nothing is wrong" and the first so many causes at their best fits.

    ``known`` is the log evidence where it is known well enough already, NaN elsewhere; minus
    infinity for causes that are not compared.
    """
    compared = [fit for fit, evidence in zip(modes, known, strict=False) if evidence != -np.inf]
    sizes = effect_sizes(problem, compared)
    candidates = []
    for cause, fit, evidence in zip([None, *causes], modes, known, strict=False):
        if np.isnan(evidence):
            evidence = np.logaddexp.reduce(node_evidence(problem, emulator, noise, fit, sizes))
        candidates.append(Candidate(cause, *fit, float(evidence)))
    return Search(problem, emulator, candidates, *probabilities(candidates), sizes, noise)


def with_processes(
    result: Search, with_remainder: bool = True, nearby: Search | None = None
) -> Search:
    """Return the search with its winners also compared given what none of them explains.

    That is noise that neighbouring rows share and, where it is asked for, a smooth discrepancy of
    unknown shape. Of a search ``nearby``, in other rows, those causes that such noise mattered to.
    """
    return _given_noise(_given_curve(result) if with_remainder else result, nearby)


def total_evidence(candidates: Sequence[Candidate]) -> FloatArray:
    """Return the log evidence of each cause, alone or given a process, whichever is true."""
    return np.asarray(special.logsumexp(_alone_and_given(candidates), axis=1))


def _ends_of(
    nearby: Search | None, problem: Problem, causes: Sequence[Cause]
) -> list[Fitted] | None:
    """Return where the same causes ended; None where it compared other causes."""
    if nearby is None:
        return None
    known = nearby.candidates[1:]
    # other rows may lack an experiment, which has a separate number
    unknowns = [(c.name, *c.parameters) for c in causes]
    if unknowns != [(w.cause.name, *w.cause.parameters) for w in known if w.cause is not None]:
        return None
    if nearby.problem.model.theta_names != problem.model.theta_names:
        return None
    return [Fitted(*w[1:5]) for w in known]


def _given_curve(result: Search) -> Search:
    """Compare the winners given a smooth discrepancy of unknown shape."""
    quick = result.probability
    process, bases = _process(result, lambda w: kind_of(w) == "unexplained")
    if process is None:
        return result
    named = [k for k, w in enumerate(result.candidates) if kind_of(w) not in _VERDICTS]
    best = max(named, key=lambda k: quick[k], default=None)
    out = []
    for k, (w, probability) in enumerate(zip(result.candidates, quick, strict=True)):
        # the best named cause always has its chance: data usually contain more than one fault
        if w is process or (probability < 0.01 and w.cause is not None and k != best):
            out.append(w)
        elif w.cause is None:
            out.append(w._replace(log_evidence_with_remainder=process.log_evidence))
        else:
            out.append(w._replace(log_evidence_with_remainder=_with_process(result, w, bases)))
    return result.reweighed(out)


def _given_noise(result: Search, nearby: Search | None) -> Search:
    """Compare the causes that explain most, given noise that neighbouring rows share.

    Such noise is no alternative to what a simulation lacks: both may be present, and alone it
    imitates a jump or a wave. "None" given such noise is a separate cause.
    """
    process, bases = _process(result, lambda w: w.cause is not None and w.cause.is_correlated_noise)
    if process is None:
        return result
    prior = np.log(prior_odds([w.cause for w in result.candidates]))
    value = prior + [w.log_evidence for w in result.candidates]
    able = [
        k
        for k, w in enumerate(result.candidates)
        if w.cause is not None and w.cause.changes_output and kind_of(w) not in _VERDICTS
        if nearby is None or nearby.probability[k] * nearby.correlated[k] > _MATTERS
    ]
    out = list(result.candidates)
    for k in sorted(able, key=lambda k: -value[k])[: SETTINGS.given_noise]:
        evidence = _with_process(result, out[k], bases)
        out[k] = out[k]._replace(log_evidence_with_noise=evidence)
    return result.reweighed(out)


def _process(
    result: Search, belongs: Callable[[Candidate], bool]
) -> tuple[Candidate | None, FloatArray]:
    """Return the best of some processes and its columns of unit size at each length, (L, n, q).

    Of several outputs that in the one which needs it most; None where none was compared.
    """
    processes = [w for w in result.candidates if belongs(w)]
    process = max(processes, key=lambda w: w.log_evidence, default=None)
    if process is None:
        return None, np.empty((0, 0, 0))
    model, lengths = process.model, make_grid(process.model)
    values = np.repeat(model.values(np.zeros((1, model.n_unknowns))), len(lengths.points), axis=0)
    values[:, lengths.nodes] = lengths.points
    own = [owner == len(model.effects) - 1 for owner, _ in model.column_names]
    bases = model.added(result.problem.X, values)[:, :, own]
    rms = np.sqrt(np.mean(np.sum(bases**2, axis=2), axis=1))
    return process, bases / rms[:, None, None]


def _with_process(result: Search, w: Candidate, bases: FloatArray) -> float:
    """Return the log evidence of a cause given a process of unknown length and size."""
    problem, noise, sizes = result.problem, result.noise, result.sizes
    parts = linearise(w.model, problem.X, result.emulator, w.grid, w.mode.z)
    nodes = scan(parts, problem.y[None], w.sigma, noise, sizes)[0]
    # zero but for causes that were placed together, whose evidence is not that of the last one
    beyond_last = w.log_evidence - float(special.logsumexp(nodes))
    best_first = np.argsort(-nodes)
    likely = best_first[nodes[best_first] > nodes.max() - 10.0]
    parts = parts.at(likely)
    if w.cause is not None and w.cause.is_process and len(w.grid.nodes) == 1:
        parts = _of_neighbours(parts, w.grid.points[likely, 0], nodes[likely])
    beyond_node = 0.0
    if parts.noise_differs:
        # every node would need a factorisation: that of the best one gives what a curve adds
        parts = settled(parts, problem.y, w.sigma)
        plain = scan(parts, problem.y[None], w.sigma, noise, sizes)[0]
        beyond_node = float(special.logsumexp(nodes)) - float(plain[0])
    terms = scan_with_process(parts, problem.y, w.sigma, noise, sizes, bases, sizes[::2])
    added = float(np.logaddexp.reduce(terms, axis=None)) - np.log(len(bases) * len(sizes[::2]))
    return added + beyond_node + beyond_last


def _of_neighbours(parts: Linearised, places: FloatArray, nodes: FloatArray) -> Linearised:
    """Return the model at few nodes, each with the prior mass of a group of neighbours.

    The columns of a process are many, and change slowly with its length.
    """
    if len(places) <= SETTINGS.lengths_with_process:
        return parts
    density, chosen, weight = nodes - parts.log_weight, [], []
    for group in np.array_split(np.argsort(places), SETTINGS.lengths_with_process):
        mass = np.logaddexp.reduce(parts.log_weight[group])
        mean = np.logaddexp.reduce(nodes[group]) - mass
        chosen.append(group[np.argmin(np.abs(density[group] - mean))])
        weight.append(mass)
    return replace(parts.at(np.array(chosen)), log_weight=np.array(weight))


def prior_odds(causes: Sequence[Cause | None]) -> FloatArray:
    """Return the prior probability of each cause, None for nothing that is wrong.

    Kinds share the prior equally, and the forms of a kind share that of their kind. Causes that
    differ only in their level share that of one form.
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


def probabilities(
    candidates: Sequence[Candidate],
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the probability of each cause, of a remainder and of correlated noise given it."""
    parts = _alone_and_given(candidates)
    log_total = special.logsumexp(parts, axis=1)
    # of what is impossible there are no shares
    shares = np.exp(parts - np.where(np.isfinite(log_total), log_total, 0.0)[:, None])
    log_total = log_total + np.log(prior_odds([w.cause for w in candidates]))
    return np.exp(log_total - special.logsumexp(log_total)), shares[:, 1], shares[:, 2]


def _alone_and_given(candidates: Sequence[Candidate]) -> FloatArray:
    """Return log evidence and prior of each cause alone, given a curve, given noise, (k, 3)."""
    alone = np.array([w.log_evidence for w in candidates])
    given = np.array(
        [[w.log_evidence_with_remainder, w.log_evidence_with_noise] for w in candidates]
    )
    # "none" with a remainder is "unexplained", which is compared separately
    named = np.array([w.cause is not None for w in candidates])
    splits = np.isfinite(given) & named[:, None]
    prior = np.where(splits, [SETTINGS.prior_remainder, _prior_of_paths(candidates)], 0.0)
    with np.errstate(divide="ignore"):
        log_given = np.where(splits, given, 0.0) + np.log(prior)
    return np.column_stack([alone + np.log1p(-prior.sum(axis=1)), log_given])


def _prior_of_paths(candidates: Sequence[Candidate]) -> float:
    """Return how probable correlated noise is before the data: given a cause as without one."""
    odds = prior_odds([w.cause for w in candidates])
    alone = [w.cause is not None and w.cause.is_correlated_noise for w in candidates]
    paths = float(odds[alone].sum())
    return paths / (paths + odds[0])


def kind_of(candidate: Candidate) -> str:
    """Return the kind of a compared cause, "none" for the null."""
    return "none" if candidate.cause is None else candidate.cause.kind


def leader(result: Search) -> int:
    """Return the position of the most probable cause other than "none".

    By what it concerns first, then by kind, then by target: what only scatters the measurements and
    what changes the mean do not win by being split among more kinds.
    """
    families, shares = family_shares(result), kind_shares(result)
    family = max(families, key=lambda name: families[name])
    within = [w for w in result.candidates[1:] if _family(w) == family]
    kind = max(map(kind_of, within), key=lambda name: shares[name])
    if kind in _VERDICTS:  # a curve of any shape, where it is more probable than every kind
        kind = max(shares, key=lambda name: shares[name])
        within = [w for w in result.candidates[1:] if kind_of(w) == kind]
    member = [
        k
        for k, w in enumerate(result.candidates)
        if any(w is one for one in within) and kind_of(w) == kind
    ]
    return max(member, key=lambda k: result.probability[k])


def family_shares(result: Search) -> dict[str, float]:
    """Return the probability of each thing at fault, `Cause.concerns`, given that there is one."""
    shares: dict[str, float] = {}
    for w, probability in zip(result.candidates[1:], result.probability[1:], strict=True):
        shares[_family(w)] = shares.get(_family(w), 0.0) + float(probability)
    total = sum(shares.values())
    return {family: value / total for family, value in shares.items()} if total else shares


def _family(candidate: Candidate) -> str:
    assert candidate.cause is not None
    return candidate.cause.concerns


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
