"""Step 1 under Student-t noise: a scale mixture of normals keeps the coefficients collapsed.

A t density is a normal one whose precision, lambda / sigma^2, is itself gamma distributed (West
1987, Biometrika 74:646). To the power alpha it is proportional to

    integral of lambda^(a - 1) exp(-lambda (df + z^2) / 2) d lambda,  a = alpha (df + 1) / 2,

so given the lambdas the coefficients are Gaussian and integrate out, for any power. Many chains
take turns: u given lambda by moves on the collapsed density, the coefficients exactly, then lambda.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import emcee
import numpy as np
from numpy.typing import NDArray

from hybridsurrogate.inference.collapsed import ROUNDING, CollapsedPosterior
from hybridsurrogate.inference.laplace import LaplacePosterior
from hybridsurrogate.inference.moves import differences
from hybridsurrogate.likelihoods.student_t import StudentT
from hybridsurrogate.priors import FloatArray

_CHAINS, _BURN, _STEPS = 100, 150, 400
# hyperparameters make every chain's matrices its own, and dear
_CHAINS_WITH_HYPER = 40
# moves of u between two draws of the lambdas: lambda and sigma hold each other in place
_MOVES = 3


@dataclass(frozen=True)
class MixtureDraws:
    """Draws of u (S, d), c (S, p) and a (S, q), and the autocorrelation time of u in steps."""

    u: FloatArray
    c: FloatArray
    a: FloatArray
    autocorrelation_time: float
    effective_draws: float


@dataclass(frozen=True)
class _GivenMixture(CollapsedPosterior):
    """The collapsed posterior of chains that have lambdas of their own.

    Attributes
    ----------
    run_products : ndarray of shape (n_runs, k)
        Upper triangles of the outer products of each run's [features, y].
    run_lambda, row_lambda : ndarray of shape (C, n_runs), (C, n)
        Lambdas times the powers of the rows.
    """

    run_products: FloatArray
    run_lambda: FloatArray
    row_lambda: FloatArray

    @property
    def _fixed(self) -> bool:
        return False

    @property
    def _few(self) -> bool:
        return False

    def _blocks(self, u: FloatArray) -> list[FloatArray]:
        return [u]  # chains are few, and each has its own lambdas

    def take(self, chains: NDArray[np.intp]) -> _GivenMixture:
        return replace(self, run_lambda=self.run_lambda[chains], row_lambda=self.row_lambda[chains])

    def _gram(self, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        p, q = len(self.model.basis.coefficient_mean), len(self.model.column_sd)
        out = np.zeros((len(u), p + q + 1, p + q + 1))
        log_noise = np.zeros(len(u))
        if self.row_lambda.any():
            parts = self.model.parts(self.X, self.model.values(u[:, :-1]))
            residual = (self.y - parts.known)[..., None]
            rows = np.concatenate([parts.features, parts.columns, residual], axis=2)
            rows *= (np.sqrt(self.row_lambda) / parts.noise)[..., None]
            log_noise = np.log(np.broadcast_to(parts.noise, self.row_lambda.shape)) @ self.weights
            np.matmul(np.swapaxes(rows, 1, 2), rows, out=out)
        if self.run_lambda.shape[1]:
            upper = np.triu_indices(p + 1)
            index = np.r_[:p, p + q]
            products = self.run_lambda @ self.run_products
            out[:, index[upper[0]], index[upper[1]]] += products
            off = upper[0] != upper[1]
            out[:, index[upper[1][off]], index[upper[0][off]]] += products[:, off]
        lambdas = self.row_lambda.sum(axis=1) + self.run_lambda.sum(axis=1)
        out[:, -1, -1] += lambdas * (ROUNDING * self.scale) ** 2
        return out, log_noise


def mixture_draws(
    target: LaplacePosterior,
    start: FloatArray,
    n_draws: int,
    random_state: np.random.RandomState,
) -> MixtureDraws:
    """Draw all unknowns of step 1 under Student-t noise.

    Parameters
    ----------
    target : LaplacePosterior
        With a `StudentT` likelihood and a surrogate that is linear in its coefficients.
    start : ndarray of shape (m, d)
        Draws of u near the answer, in random order.
    n_draws : int
    random_state : RandomState
    """
    likelihood = target.likelihood
    assert isinstance(likelihood, StudentT)
    model = target.model
    C = min(_CHAINS_WITH_HYPER if model.n_hyper else _CHAINS, len(start))
    u = start[:C].copy()
    with_runs = target.runs is not None and bool(target.simulation_power)
    features: FloatArray = np.empty((0, len(model.basis.coefficient_mean)))
    run_y: FloatArray = np.empty(0)
    run_shape: FloatArray = np.empty(0)
    if with_runs:
        assert target.runs is not None
        runs = target.runs
        features = model.basis.features(runs.X, runs.omega)
        run_y = runs.y - model.basis.known(runs.X, runs.omega)
        run_shape = target.simulation_power * runs.weights * (likelihood.df + 1) / 2
    row_shape = target.measured_power * target.weights * (likelihood.df + 1) / 2
    run_rows = np.column_stack([features, run_y])
    upper = np.triu_indices(run_rows.shape[1])
    given = _GivenMixture(
        model,
        target.X,
        target.observed,
        target.weights,
        None,
        1.0,
        target.measured_power,
        target.noise_prior,
        target.scale,
        run_rows[:, upper[0]] * run_rows[:, upper[1]],
        np.broadcast_to(run_shape / (likelihood.df / 2), (C, len(run_y))),
        np.broadcast_to(row_shape / (likelihood.df / 2), (C, len(target.y))),
    )
    n_powered = float(np.sum(run_shape)) * 2 / (likelihood.df + 1)
    halves = np.array_split(np.arange(C), 2)
    chain, kept_c, kept_a = [], [], []
    for step in range(_BURN + _STEPS):
        for mine, other in (halves, halves[::-1]) * _MOVES:
            part = given.take(mine)
            trial = u[mine] + differences(u[other], len(mine), random_state, step)
            gain = _density(part, trial, n_powered) - _density(part, u[mine], n_powered)
            take = np.log(random_state.uniform(size=len(mine))) < gain
            u[mine[take]] = trial[take]
        c, a = given.draw_coefficients(u, random_state)
        sigma = np.exp(u[:, -1:])
        parts = model.parts(target.X, model.values(u[:, :-1]))
        eta = parts.known + (parts.features @ c[..., None])[..., 0]
        eta = eta + (parts.columns @ a[..., None])[..., 0]
        row_z = (target.observed - eta) / (parts.noise * sigma)
        run_z = (run_y - c @ features.T) / sigma
        given = replace(
            given,
            row_lambda=_lambdas(row_shape, row_z, likelihood.df, random_state),
            run_lambda=_lambdas(run_shape, run_z, likelihood.df, random_state),
        )
        if step >= _BURN:
            chain.append(u.copy())
            kept_c.append(c)
            kept_a.append(a)
    tau = emcee.autocorr.integrated_time(np.array(chain), tol=0)
    longest = float(np.max(np.where(np.isfinite(tau), tau, _STEPS)))
    index = random_state.permutation(np.linspace(0, _STEPS * C - 1, n_draws).astype(int))
    return MixtureDraws(
        np.concatenate(chain)[index],
        np.concatenate(kept_c)[index],
        np.concatenate(kept_a)[index],
        longest,
        _STEPS * C / longest,
    )


def _density(given: _GivenMixture, u: FloatArray, n_powered: float) -> FloatArray:
    """Return the collapsed density, the runs' share of the powers of sigma included."""
    density = given.log_density(u) - n_powered * u[:, -1]
    return np.where(np.isfinite(density), density, -1e300)


def _lambdas(
    shape: FloatArray, z: FloatArray, df: float, random_state: np.random.RandomState
) -> FloatArray:
    return random_state.standard_gamma(np.broadcast_to(shape, z.shape)) / ((df + z**2) / 2)
