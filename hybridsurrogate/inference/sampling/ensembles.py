"""Ensembles of Markov chains: emcee over walkers, and one chain for each coefficient draw.

One chain for each coefficient draw is for a measured world without a grid or a closed form. These
start from a shared pool, drawn with
weights by each chain's density. They move by differences between chains of the other half
(differential evolution, Ter Braak 2006, Statistics and Computing 16:239). The halves take turns, so
each update leaves the product of all conditional posteriors invariant.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from numbers import Integral, Real
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from sklearn.base import BaseEstimator
from sklearn.utils import check_scalar

from hybridsurrogate.arguments import check_flag, check_number, described, local_path
from hybridsurrogate.inference.sampling.modes import (
    Gaussian,
    LogDensity,
    NothingPossibleError,
    PairLogDensity,
)
from hybridsurrogate.inference.sampling.settings import SETTINGS
from hybridsurrogate.notebook import filled
from hybridsurrogate.types import FloatArray

if TYPE_CHECKING:
    import emcee


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
    n_steps : int
    converged : bool
        Whether the run is longer than ``tol`` autocorrelation times.
    """

    draws: FloatArray
    autocorrelation_time: float
    effective_draws: float
    n_steps: int
    converged: bool


class EnsembleSampler(BaseEstimator):
    """Ensemble MCMC backend (emcee) with a stopping rule.

    Pass it as ``sampler=`` of an estimator to use it instead of importance sampling. The run stops
    when it is longer than ``tol`` autocorrelation times; the first five of them are dropped.

    Parameters
    ----------
    n_walkers : int or None, default=None
        None: four times the number of dimensions, at least 40.
    moves : emcee move, sequence of them or of (move, weight), or None, default=None
        None: preconditioned Crank-Nicolson moves about the Gaussian approximation at the best
        mode, differential evolution, and the stretch move.
    max_steps : int, default=10000
        Where the run stops unconverged, with a `SamplingWarning`.
    tol : float, default=50
        Length of the run in autocorrelation times.
    progress : bool, default=False
        Show a progress bar.
    file : path or None, default=None
        HDF5 file that keeps every step (needs h5py). A run that was stopped goes on from there and
        ends with the result of an unbroken one. Each run has a separate group, named after its
        starting points: the estimator must have an int ``random_state``.

    Examples
    --------
    >>> import hybridsurrogate as hs
    >>> model = hs.PowerScaledSurrogate(sampler=hs.EnsembleSampler(max_steps=2000))
    >>> model.get_params()["sampler__max_steps"]
    2000
    """

    def __init__(
        self,
        n_walkers: int | None = None,
        moves: Any = None,
        max_steps: int = 10_000,
        tol: float = 50.0,
        progress: bool = False,
        file: str | None = None,
    ):
        self.n_walkers = n_walkers
        self.moves = moves
        self.max_steps = max_steps
        self.tol = tol
        self.progress = progress
        self.file = file

    def run(
        self,
        log_density: LogDensity,
        modes: list[Gaussian],
        n_draws: int,
        random_state: np.random.RandomState,
    ) -> EnsembleDraws:
        """Sample a density, walkers starting spread over its modes by their mass.

        Parameters
        ----------
        log_density : callable
            Takes points (J, d) and returns (J,).
        modes : list of Gaussian
        n_draws : int
        random_state : RandomState

        Returns
        -------
        EnsembleDraws

        Raises
        ------
        ValueError
            When no walker has a finite density.
        """
        d = len(modes[0].mean)
        self._check(d)
        n_walkers = self.n_walkers or max(40, 4 * d)
        start = _spread_over(modes, n_walkers, log_density, random_state)
        seed = random_state.randint(2**31 - 1)
        try:
            sampler, tau, converged = self._sampled(log_density, start, modes[0], seed)
        except BlockingIOError as error:
            raise BlockingIOError(
                f"{self.file} is being written by another process: fits that run side by side, as "
                "in a search with n_jobs, cannot share EnsembleSampler(file=...). Use n_jobs=1 or "
                "file=None."
            ) from error
        except OSError as error:
            if self.file is None:
                raise
            raise OSError(
                f"EnsembleSampler(file={str(self.file)!r}) cannot be read or written ({error}). "
                "Where its folder is there, the file is damaged or no HDF5 file: name another one, "
                "or delete it to sample anew."
            ) from error
        burn = int(min(5 * tau, sampler.iteration // 2))
        return _thinned(sampler, burn, tau, converged, n_draws, random_state)

    def _sampled(
        self, log_density: LogDensity, start: FloatArray, about: Gaussian, seed: int
    ) -> tuple[emcee.EnsembleSampler, float, bool]:
        """Return the sampler after its run, its autocorrelation time, whether it converged."""
        import emcee

        sampler = emcee.EnsembleSampler(
            *start.shape,
            log_density,
            vectorize=True,
            moves=self.moves or _moves_about(about),
            backend=self._backend(start, seed),
        )
        state = emcee.State(start, random_state=np.random.RandomState(seed).get_state())
        if self.file is not None and sampler.backend.iteration:
            state = sampler.backend.get_last_sample()
        tau, converged = np.inf, False
        with filled(self.max_steps, "Steps of the ensemble, at most", self.progress) as done:
            done.update(sampler.iteration)
            while True:
                if sampler.iteration and sampler.iteration % SETTINGS.ensemble_steps == 0:
                    tau = _autocorrelation_time(sampler)
                    converged = sampler.iteration > self.tol * tau
                if converged or sampler.iteration >= self.max_steps:
                    break
                # always to the next multiple: a resumed run decides where an unbroken one would
                steps = SETTINGS.ensemble_steps - sampler.iteration % SETTINGS.ensemble_steps
                steps = min(steps, self.max_steps - sampler.iteration)
                # walkers are draws of a Gaussian: a ridge of any narrowness is no fault of theirs
                state = sampler.run_mcmc(state, steps, skip_initial_state_check=True)
                done.update(steps)
        return sampler, tau, converged

    def _check(self, d: int) -> None:
        check_scalar(self.max_steps, "max_steps", Integral, min_val=1)
        check_flag(self.progress, "progress")
        import emcee

        if not (self.moves is None or isinstance(self.moves, emcee.moves.Move | list)):
            raise TypeError(
                "moves must be None, a move of emcee's, such as emcee.moves.StretchMove(), or a "
                f"list of them with weights, got {described(self.moves)}."
            )
        if self.file is not None:
            local_path(self.file, "file")
        check_number(self.tol, "tol", Real, min_val=0, include_boundaries="neither")
        if self.n_walkers is not None:
            check_scalar(self.n_walkers, "n_walkers", Integral, min_val=2)
            if self.n_walkers < 2 * d or self.n_walkers % 2:
                raise ValueError(
                    f"n_walkers must be even and at least twice the {d} dimensions that are "
                    f"sampled, got {self.n_walkers}."
                )

    def _backend(self, start: FloatArray, seed: int) -> Any:
        if self.file is None:
            return None
        try:
            import h5py  # noqa: F401
        except ImportError:
            raise ImportError(
                "EnsembleSampler(file=...) keeps its steps in HDF5, which needs h5py: "
                "pip install h5py, or leave file=None."
            ) from None
        import emcee

        digest = hashlib.sha256(start.tobytes() + str(seed).encode()).hexdigest()[:16]
        backend = emcee.backends.HDFBackend(str(self.file), name=f"run_{digest}")
        if not backend.initialized:
            backend.reset(*start.shape)
            return backend
        try:
            if backend.iteration:
                backend.get_last_sample()
        except (KeyError, RuntimeError, TypeError, ValueError) as error:
            raise OSError(f"its steps cannot be read: {error}") from error
        return backend


def _moves_about(approximation: Gaussian) -> list[tuple[Any, float]]:
    """Return the default moves, most of them about a Gaussian approximation.

    They keep a share of the distance from its mean and renew the rest: preconditioned
    Crank-Nicolson (Cotter, Roberts, Stuart and White 2013, Statistical Science 28:424), reversible
    for the Gaussian, so that the acceptance depends only on how the density differs from it. Where
    it is near, draws are nearly independent in any dimension; where not, small steps are among
    them.
    """
    import emcee

    mean, factor = approximation.mean, approximation.factor

    def proposal(points: FloatArray, random_state: Any) -> tuple[FloatArray, FloatArray]:
        standard = np.linalg.solve(factor, (points - mean).T).T
        kept = np.sqrt(random_state.uniform(size=(len(points), 1)))
        fresh = random_state.standard_normal(points.shape)
        moved = kept * standard + np.sqrt(1 - kept**2) * fresh
        log_ratio = 0.5 * (np.sum(moved**2, axis=1) - np.sum(standard**2, axis=1))
        return mean + moved @ factor.T, log_ratio

    # differential evolution (Ter Braak 2006, Statistics and Computing 16:239) next to the stretch
    # move, and now and then jumps of full length between modes
    shares = {
        emcee.moves.DEMove(): 0.6,
        emcee.moves.DEMove(gamma0=1.0): 0.1,
        emcee.moves.StretchMove(): 0.3,
    }
    others = [(move, (1 - SETTINGS.gaussian_moves) * share) for move, share in shares.items()]
    return [(emcee.moves.MHMove(proposal), SETTINGS.gaussian_moves), *others]


def _thinned(
    sampler: emcee.EnsembleSampler,
    burn: int,
    tau: float,
    converged: bool,
    n_draws: int,
    random_state: np.random.RandomState,
) -> EnsembleDraws:
    chain = sampler.get_chain(discard=burn, flat=True)
    index = np.linspace(0, len(chain) - 1, n_draws).astype(int)
    return EnsembleDraws(
        random_state.permutation(chain[index]),
        tau,
        len(chain) / tau,
        int(sampler.iteration),
        bool(converged),
    )


def _autocorrelation_time(sampler: emcee.EnsembleSampler) -> float:
    # of a thousand steps: one in a twentieth of the time at which a chain is long enough changes it
    # by 0.1 %, and with all steps a quarter of a long run is spent here
    thin = max(1, int(sampler.iteration) // 1000)
    with np.errstate(invalid="ignore"):  # a walker that never moved has no autocorrelation
        tau = float(np.max(sampler.get_autocorr_time(tol=0, thin=thin)))
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
    pool = np.stack([mode.draws(n_walkers, random_state) for mode in modes])
    start = pool[member, np.arange(n_walkers)]
    bad = ~np.isfinite(log_density(start))
    if bad.any():
        start[bad] = modes[0].mean + 1e-3 * random_state.standard_normal((bad.sum(), d))
    if not np.isfinite(log_density(start)).any():
        raise NothingPossibleError(
            "The ensemble sampler cannot start: the log density is minus infinity at every "
            "walker. Check priors and units."
        )
    return start


class Effort(NamedTuple):
    """How many moves each chain makes, and how many starts it chooses from besides its own."""

    steps: int
    pool: int


# from places near the answer; from draws of it
FROM_NEAR, FROM_DRAWS = Effort(160, 60), Effort(30, 0)


def moved_draws(
    log_density: PairLogDensity,
    start: FloatArray,
    random_state: np.random.RandomState,
    effort: Effort = FROM_NEAR,
) -> tuple[FloatArray, float]:
    """Draw from the conditional density of each chain.

    Parameters
    ----------
    log_density : callable
    start : ndarray of shape (S, d)
        Draws near the answer, one for each chain; some of them also make the shared pool.
    random_state : RandomState
    effort : Effort

    Returns
    -------
    points : ndarray of shape (S, d)
    accepted : float
        Median over chains of the number of accepted moves.
    """
    S = len(start)
    points, value = _best_of_pool(log_density, start, random_state, effort.pool)
    accepted = np.zeros(S)
    halves = np.array_split(random_state.permutation(S), 2)
    for step in range(effort.steps):
        for mine, other in (halves, halves[::-1]):
            trial = points[mine] + differences(points[other], len(mine), random_state, step)
            new = log_density(trial, mine)
            with np.errstate(invalid="ignore"):  # both may be minus infinity
                take = np.log(random_state.uniform(size=len(mine))) < new - value[mine]
            points[mine[take]], value[mine[take]] = trial[take], new[take]
            accepted[mine[take]] += 1
    return points, float(np.median(accepted))


def _best_of_pool(
    log_density: PairLogDensity, start: FloatArray, random_state: np.random.RandomState, n: int
) -> tuple[FloatArray, FloatArray]:
    """Return for each chain its own start or one of a pool of n, by their densities."""
    S = len(start)
    chains = np.arange(S)
    pool = start[random_state.choice(S, min(n, S), replace=False)]
    value = np.stack(
        [log_density(start, chains)]
        + [log_density(np.tile(member, (S, 1)), chains) for member in pool]
    )
    if n == 0:
        return start.copy(), value[0]
    # Gumbel's trick: the maximum of log weight + Gumbel noise is a draw by weight
    noisy = value + random_state.gumbel(size=value.shape)
    pick = np.where(np.isfinite(value), noisy, -np.inf).argmax(axis=0)
    points = np.where((pick == 0)[:, None], start, pool[np.maximum(pick - 1, 0)])
    return points, value[pick, chains]


def differences(
    others: FloatArray, n: int, random_state: np.random.RandomState, step: int
) -> FloatArray:
    """Return n moves: scaled differences of two other chains, every tenth step of full length."""
    d = others.shape[1]
    first = random_state.randint(len(others), size=n)
    second = random_state.randint(len(others), size=n)
    size = 1.0 if step % 10 == 9 else 2.38 / np.sqrt(2 * d)
    if step % 10 != 9:
        size = size * SETTINGS.smallest_move ** random_state.uniform(size=(n, 1))
    # a subset of the dimensions at a time: in many dimensions single ones move farther
    kept = random_state.uniform(size=(n, d)) < random_state.choice([0.3, 1.0], size=(n, 1))
    jitter = 1e-6 * random_state.standard_normal((n, d))
    return size * kept * (others[first] - others[second]) + jitter
