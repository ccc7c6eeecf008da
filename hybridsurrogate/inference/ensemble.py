"""Ensemble MCMC by emcee, vectorised over walkers."""

from __future__ import annotations

from dataclasses import dataclass

import emcee
import numpy as np

from hybridsurrogate.inference.importance import Gaussian, LogDensity, student_draws
from hybridsurrogate.priors import FloatArray

_BLOCK = 200
_MAX_STEPS = 4000
_EQUILIBRIUM_WALKERS, _EQUILIBRIUM_STEPS = 400, 50


@dataclass(frozen=True)
class EnsembleDraws:
    """Draws of an ensemble run.

    Attributes
    ----------
    draws : ndarray of shape (n_draws, d)
    autocorrelation_time : float
        Longest over the dimensions, in steps of the ensemble.
    effective_draws : float
        Kept draws divided by the autocorrelation time.
    acceptance : float
        Mean acceptance fraction.
    converged : bool
        Whether the run is longer than 50 autocorrelation times.
    """

    draws: FloatArray
    autocorrelation_time: float
    effective_draws: float
    acceptance: float
    converged: bool


def ensemble_draws(
    log_density: LogDensity,
    modes: list[Gaussian],
    n_draws: int,
    random_state: np.random.RandomState,
    equilibrium: FloatArray | None = None,
) -> EnsembleDraws:
    """Run emcee and stop by autocorrelation time.

    Differential-evolution moves (Ter Braak 2006, Statistics and Computing 16:239) beside the
    stretch move, and now and then jumps of full length between modes.

    Parameters
    ----------
    log_density : callable
    modes : list of Gaussian
        Walkers start spread over the modes by their mass.
    n_draws : int
    random_state : RandomState
    equilibrium : ndarray of shape (m, d) or None
        Draws that already follow the density, for example trustworthy importance draws. Walkers
        start there: modes far apart keep their shares, and a short run is enough.
    """
    d = len(modes[0].mean)
    start = (
        _spread_over(modes, max(40, 4 * d), log_density, random_state)
        if equilibrium is None
        else equilibrium[:_EQUILIBRIUM_WALKERS]
    )
    moves = [
        (emcee.moves.DEMove(), 0.6),
        (emcee.moves.DEMove(gamma0=1.0), 0.1),
        (emcee.moves.StretchMove(), 0.3),
    ]
    sampler = emcee.EnsembleSampler(len(start), d, log_density, vectorize=True, moves=moves)
    state = emcee.State(
        start, random_state=np.random.RandomState(random_state.randint(2**31 - 1)).get_state()
    )
    if equilibrium is not None:
        sampler.run_mcmc(state, _EQUILIBRIUM_STEPS)
        tau, burn, converged = _autocorrelation_time(sampler), 0, True
    else:
        tau, converged = np.inf, False
        while sampler.iteration < _MAX_STEPS and not converged:
            state = sampler.run_mcmc(state, _BLOCK)
            tau = _autocorrelation_time(sampler)
            converged = sampler.iteration > 50 * tau
        burn = int(min(5 * tau, sampler.iteration // 2))
    chain = sampler.get_chain(discard=burn, flat=True)
    index = np.linspace(0, len(chain) - 1, n_draws).astype(int)
    return EnsembleDraws(
        random_state.permutation(chain[index]),
        tau,
        len(chain) / tau,
        float(np.mean(sampler.acceptance_fraction)),
        bool(converged),
    )


def _autocorrelation_time(sampler: emcee.EnsembleSampler) -> float:
    with np.errstate(invalid="ignore"):  # a walker that never moved has no autocorrelation
        tau = float(np.max(sampler.get_autocorr_time(tol=0)))
    return tau if np.isfinite(tau) else np.inf


def _spread_over(
    modes: list[Gaussian],
    n_walkers: int,
    log_density: LogDensity,
    random_state: np.random.RandomState,
) -> FloatArray:
    """Return walkers spread over the modes by their mass, all at finite density."""
    d = len(modes[0].mean)
    mass = np.exp(np.array([mode.log_mass for mode in modes]) - modes[0].log_mass)
    member = random_state.choice(len(modes), size=n_walkers, p=mass / mass.sum())
    pool = np.stack([student_draws(mode, n_walkers, random_state) for mode in modes])
    start = pool[member, np.arange(n_walkers)]
    bad = ~np.isfinite(log_density(start))
    if bad.any():
        start[bad] = modes[0].mean + 1e-3 * random_state.standard_normal((bad.sum(), d))
    if not np.isfinite(log_density(start)).any():
        raise ValueError(
            "The ensemble sampler cannot start: the log density is minus infinity at every "
            "walker. Check priors and units."
        )
    return start
