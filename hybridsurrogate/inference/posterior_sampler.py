"""Draws of step 1: importance sampling around the modes, an ensemble where it is unreliable."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hybridsurrogate.inference.conjugate.target import PowerScaledPosterior, Target
from hybridsurrogate.inference.sampling.axis_proposals import elongation, ridge_through, with_lines
from hybridsurrogate.inference.sampling.ensembles import EnsembleDraws, EnsembleSampler
from hybridsurrogate.inference.sampling.hierarchical import HierarchicalTarget, standardised
from hybridsurrogate.inference.sampling.importance import (
    ImportanceDraws,
    Proposals,
    growing_draws,
    importance_draws,
)
from hybridsurrogate.inference.sampling.modes import (
    Gaussian,
    distinct,
    find_modes,
    further_points,
    starting_points,
)
from hybridsurrogate.inference.sampling.settings import MOST_PROPOSALS, SETTINGS
from hybridsurrogate.model.posterior import Diagnostics
from hybridsurrogate.numerics.psis import KHAT_LIMIT
from hybridsurrogate.types import FloatArray


@dataclass(frozen=True)
class FirstStep:
    """Draws of step 1: u (S, d), coefficients c (S, p) and a (S, q), and how good they are.

    Importance draws were chosen from ``proposals``, None where these draws were unreliable.
    """

    u: FloatArray
    c: FloatArray
    a: FloatArray
    diagnostics: Diagnostics
    proposals: Proposals | None = None


def first_step(
    plain: PowerScaledPosterior,
    sampler: str | EnsembleSampler,
    n_draws: int,
    random_state: np.random.RandomState,
) -> FirstStep:
    """Draw all unknowns of step 1."""
    starts = starting_points(plain, random_state)
    coordinates = standardised(plain.model, plain.search_density, starts)
    target: Target = plain
    if coordinates is not None:
        target, starts = HierarchicalTarget(plain, coordinates), coordinates.of(starts)
    modes, minor, has_lines = _approximations(target, _modes(target, starts))
    doubt = np.nan
    if sampler in ("auto", "importance"):
        n = max(SETTINGS.oversampling * n_draws, SETTINGS.min_proposals)
        args = target.extended_log_density, minor, n, n_draws, random_state
        sampled = importance_draws(*args, n_noise=target.n_noise, modes=modes)
        if sampler == "auto" and target.is_exact:
            sampled, modes = _improved(
                target, sampled, modes, minor, has_lines, n, n_draws, random_state
            )
        if sampled.khat <= KHAT_LIMIT or sampler == "importance":
            drawn = target.resolved(sampled.draws, random_state)
            proposals = sampled.proposals
            if isinstance(target, HierarchicalTarget):
                proposals = target.plain_proposals(proposals)
            return FirstStep(*drawn, of_importance(target, sampled, len(modes)), proposals)
        doubt = sampled.khat
    backend = sampler if isinstance(sampler, EnsembleSampler) else EnsembleSampler()
    start = modes if target.is_exact else _around(target, minor, random_state)
    run = backend.run(target.joint_log_density, start, n_draws, random_state)
    diagnostics = _of_ensemble(run, len(modes), doubt)
    return FirstStep(*target.from_ensemble(run.draws, random_state), diagnostics)


def _approximations(
    target: Target, found: list[Gaussian]
) -> tuple[list[Gaussian], list[Gaussian], bool]:
    """Return the modes that matter, what is proposed around all, and whether along lines."""
    best = found[0].log_mass
    minor = [mode for mode in found if mode.log_mass > best + np.log(SETTINGS.min_mode_share)]
    lines = with_lines(target, minor)
    best = max(line.mode.log_mass for line in lines)
    modes = [
        line.mode for line in lines if line.mode.log_mass > best + np.log(SETTINGS.min_proposed)
    ]
    proposals = [proposal for line in lines for proposal in line.proposals]
    return modes, proposals, any(line.position is not None for line in lines)


def evidence_around(
    target: Target,
    starts: FloatArray,
    random_state: np.random.RandomState,
) -> float:
    """Return the log evidence of a density whose modes are near starts u (k, d), by importance.

    NaN where no start is possible. The reliability of the weights is not checked here.
    """
    value = target.search_density(starts)
    if not np.isfinite(value).any():
        return np.nan
    starts = starts[np.argsort(-value)[: SETTINGS.evidence_starts]]
    found = find_modes(target.search_density, starts, target.model.least_step)
    modes, minor, _ = _approximations(target, found)
    args = target.extended_log_density, minor, SETTINGS.min_proposals, 1, random_state
    sampled = importance_draws(*args, n_noise=target.n_noise, modes=modes)
    return _log_evidence_of(target, sampled)


def _modes(target: Target, starts: FloatArray) -> list[Gaussian]:
    modes = find_modes(target.search_density, starts, target.model.least_step)
    # with one unknown in addition to sigma the starts were all there are
    if target.n_dimensions > 2:
        further = further_points(target, modes[0].mean)
        if len(further):
            modes += find_modes(target.search_density, further, target.model.least_step)
    return distinct(modes)


def _improved(
    target: Target,
    sampled: ImportanceDraws,
    modes: list[Gaussian],
    minor: list[Gaussian],
    has_lines: bool,
    n: int,
    n_draws: int,
    random_state: np.random.RandomState,
) -> tuple[ImportanceDraws, list[Gaussian]]:
    """Return better importance draws where few count: along a ridge, or from bends."""
    scarce = sampled.effective_draws < SETTINGS.min_effective_share * n
    few = sampled.khat > SETTINGS.adapted_khat or scarce
    # draws of a Gaussian on a bent ridge look good where all of them lie close to its middle; with
    # many that count and a heavy tail there is none
    adapted = len(sampled.proposals.points) > n
    thin = scarce or elongation(minor[0]) > SETTINGS.ridge_elongation
    if adapted and thin and not has_lines and target.n_dimensions > 2:
        along = _ridge_draws(target, minor, n, n_draws, random_state)
        if along is not None and along.khat > SETTINGS.adapted_khat:
            # the optimiser may have stopped next to a ridge as narrow as its steps resolve
            points = along.proposals.points
            best = points[[int(np.argmax(target.search_density(points)))]]
            climbed = find_modes(target.search_density, best, target.model.least_step)
            better = _ridge_draws(target, climbed, n, n_draws, random_state)
            along = along if better is None or better.khat > along.khat else better
        if along is not None and along.khat <= KHAT_LIMIT:
            sampled, modes = along, modes[:1]
            few = sampled.effective_draws < SETTINGS.min_effective_share * n
    if few:
        args = sampled, modes, _as_wide_as_priors(modes[0]), MOST_PROPOSALS, random_state
        again = growing_draws(target.extended_log_density, *args)
        sampled = again if again.khat <= max(sampled.khat, KHAT_LIMIT) else sampled
    return sampled, modes


def _as_wide_as_priors(mode: Gaussian) -> Gaussian:
    """Return proposals as the priors have them, with sigma as near a mode."""
    mean, factor = np.zeros_like(mode.mean), np.eye(len(mode.mean))
    mean[-1], factor[-1, -1] = mode.mean[-1], np.linalg.norm(mode.factor[-1])
    return Gaussian(mean, factor, float(np.log(SETTINGS.prior_proposal_share)))


def _ridge_draws(
    target: Target,
    modes: list[Gaussian],
    n: int,
    n_draws: int,
    random_state: np.random.RandomState,
) -> ImportanceDraws | None:
    """Return importance draws in coordinates in which the ridge through all modes is straight."""
    ridge = ridge_through(target, modes[0])
    if ridge is None or not all(ridge.is_on(mode.mean) for mode in modes[1:]):
        return None

    def straight(v: FloatArray) -> FloatArray:
        return target.extended_log_density(ridge.points(v))

    drawn = importance_draws(straight, [ridge.approximation], n, n_draws, random_state)
    proposals = replace(drawn.proposals, points=ridge.points(drawn.proposals.points))
    return replace(drawn, draws=ridge.points(drawn.draws), proposals=proposals)


def _around(
    target: Target,
    components: list[Gaussian],
    random_state: np.random.RandomState,
) -> list[Gaussian]:
    """Return Gaussians in the full space from which the ensemble starts: one around each mode."""
    d, p = target.n_dimensions, target.n_noise
    out = []
    for mode in components:
        e = random_state.standard_normal((4 * (d + p), p))
        u = mode.mean + random_state.standard_normal((len(e), d)) @ mode.factor.T
        points = target.to_ensemble(np.hstack([u, e]))
        points = points[np.isfinite(points).all(axis=1)]
        covariance = np.cov(points.T) + 1e-10 * np.eye(d + p)
        out.append(Gaussian(points.mean(axis=0), np.linalg.cholesky(covariance), mode.log_mass))
    return out


def of_importance(target: Target, sampled: ImportanceDraws, n_modes: int) -> Diagnostics:
    """Return what an estimator reports of importance draws."""
    return Diagnostics(
        "importance",
        sampled.khat,
        sampled.effective_draws,
        np.nan,
        n_modes,
        log_evidence=_log_evidence_of(target, sampled),
        log_evidence_error=sampled.log_evidence_error,
    )


def _log_evidence_of(target: Target, sampled: ImportanceDraws) -> float:
    """Return the log evidence of draws of a density, with the constants that densities leave out.

    These are of the standard normal coordinates z and, where they are drawn, v.
    """
    n_normal = target.n_dimensions - 1 + target.n_noise
    return sampled.log_evidence - 0.5 * n_normal * float(np.log(2 * np.pi))


def _of_ensemble(run: EnsembleDraws, n_modes: int, doubt: float = np.nan) -> Diagnostics:
    """Return what an estimator reports of an ensemble.

    Walkers hardly cross between modes. The shares of several modes are those of importance draws,
    as reliable as their k-hat, ``doubt``.
    """
    return Diagnostics(
        "emcee",
        doubt if n_modes > 1 else np.nan,
        run.effective_draws,
        run.autocorrelation_time,
        n_modes,
        n_steps=run.n_steps,
        converged=run.converged,
    )
