"""Draws of a fitted surrogate, their summaries, and how reliable they are."""

from __future__ import annotations

import warnings
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hybridsurrogate.effects.base import NOISE_SD, Cause
from hybridsurrogate.effects.context import Context, OfOutput
from hybridsurrogate.effects.noise.known_errors import Jitter
from hybridsurrogate.effects.noise.noise import OutputNoise
from hybridsurrogate.effects.wrapped import prepared_for
from hybridsurrogate.exceptions import FailedRunsWarning, SamplingWarning
from hybridsurrogate.likelihoods import Likelihood
from hybridsurrogate.model.observation import MeasuredModel
from hybridsurrogate.model.problem import Problem
from hybridsurrogate.numerics.digits import number
from hybridsurrogate.numerics.linear_algebra import LARGE_BLOCK, blocks
from hybridsurrogate.numerics.psis import KHAT_LIMIT
from hybridsurrogate.types import FloatArray

# step 1 is doubtful with fewer effective draws
MIN_EFFECTIVE = 100.0
# step 2 is doubtful with fewer effective proposals, or accepted moves, a draw
MIN_EFFECTIVE_EACH = 10.0
# draws that suffice for a mean, for the best of them, for a start, for averages over less probable
# causes, and for scores whose difference counts: at many weights, or without one row
FEW_DRAWS = 200
# and for an average over them of what takes long at each, over runs and rows
SOME_DRAWS = 50


@dataclass(frozen=True)
class Diagnostics:
    """How the draws were made and how good they are.

    Attributes
    ----------
    sampler : str
        "importance" or "emcee".
    khat : float
        Pareto shape of the importance weights in step 1, of several modes the largest; above 0.7
        they are unreliable (NaN for emcee, unless the modes' shares are uncertain).
    effective_draws : float
        Effective sample size of step 1.
    autocorrelation_time : float
        Of the ensemble, in steps (NaN for importance sampling).
    n_modes : int
        Modes detected.
    second_step : str
        "grid", "importance", "moves" or "none" (nothing was left to infer).
    second_khat, second_effective_draws : float
        The same for step 2, medians over the coefficient draws (NaN on a grid); for moves the
        accepted ones.
    n_steps : int
        Steps of the ensemble (0 for importance sampling).
    converged : bool
        Whether the ensemble ran long enough for its stopping rule.
    log_evidence, log_evidence_error : float
        Log of the integral of prior times likelihoods of step 1, each to its power, and its Monte
        Carlo standard error (NaN for emcee, which does not estimate it).
    """

    sampler: str
    khat: float
    effective_draws: float
    autocorrelation_time: float
    n_modes: int
    second_step: str = "none"
    second_khat: float = np.nan
    second_effective_draws: float = np.nan
    n_steps: int = 0
    converged: bool = True
    log_evidence: float = np.nan
    log_evidence_error: float = np.nan

    def problems(self) -> list[str]:
        """Return what is wrong with the draws, in words; empty when nothing is."""
        found = []
        if self.khat > KHAT_LIMIT:
            found.append(f"the Pareto k-hat of step 1 is {self.khat:.2f} (limit {KHAT_LIMIT})")
        if self.effective_draws < MIN_EFFECTIVE:
            found.append(
                f"step 1 has only {self.effective_draws:.0f} effective draws "
                f"(at least {MIN_EFFECTIVE:.0f} wanted)"
            )
        if not self.converged:
            found.append(
                f"the ensemble of step 1 stopped after {self.n_steps} steps, too few for its "
                f"autocorrelation time of {self.autocorrelation_time:.0f}"
            )
        if self.second_khat > KHAT_LIMIT:
            found.append(
                f"the Pareto k-hat of step 2 is {self.second_khat:.2f} (limit {KHAT_LIMIT})"
            )
        if self.second_effective_draws < MIN_EFFECTIVE_EACH:
            what = "accepted moves" if self.second_step == "moves" else "effective proposals"
            found.append(f"step 2 rests on {self.second_effective_draws:.1f} {what} a draw")
        return found

    def warn(self) -> None:
        """Warn when the draws are unreliable."""
        problems = self.problems()
        if problems:
            ways = [] if self.sampler == "emcee" else ["sampler='emcee'"]
            if not self.converged:
                ways.append("EnsembleSampler with a larger max_steps")
            advice = ", ".join([*ways, "more n_draws", "tighter priors"])
            warnings.warn(
                f"The posterior draws are doubtful: {'; '.join(problems)}. Try {advice}, or a "
                "lower surrogate degree.",
                SamplingWarning,
                stacklevel=4,
            )


@dataclass(frozen=True)
class Posterior:
    """Draws of everything that a prediction needs.

    Attributes
    ----------
    model : MeasuredModel
    plain_likelihood : Likelihood
        Of rows that are no outliers.
    values : ndarray of shape (S, n_unknowns)
        omega and theta in the user's units.
    sigma : ndarray of shape (S,)
    coefficients : ndarray of shape (S, p)
    effect_coefficients : ndarray of shape (S, q)
    """

    model: MeasuredModel
    plain_likelihood: Likelihood
    values: FloatArray
    sigma: FloatArray
    coefficients: FloatArray
    effect_coefficients: FloatArray

    def __repr__(self) -> str:
        return f"Posterior({self.n_draws} draws of {', '.join(self.named())})"

    @property
    def n_draws(self) -> int:
        """Number of draws."""
        return len(self.sigma)

    @property
    def likelihood(self) -> Likelihood:
        """The likelihood of measured rows, with outliers where a cause has some."""
        return self.model.likelihood_of(self.plain_likelihood, self.values)

    def take(self, index: NDArray[np.intp]) -> Posterior:
        """Return the posterior with some of its draws."""
        names = ("values", "sigma", "coefficients", "effect_coefficients")
        return replace(self, **{name: getattr(self, name)[index] for name in names})

    def eta(self, X: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return eta and the noise scale for rows X (n, n_columns): two arrays (S, n).

        Draws for which the simulation fails at a row count as impossible there.
        """
        width = self.coefficients.shape[1] + self.effect_coefficients.shape[1] + 2
        # measured outputs stay together
        given = self.model.conditional(X, self.values[:1]) is not None
        numbers = 0 if given else self.n_draws * width
        cuts = blocks(len(X), numbers, LARGE_BLOCK) or [slice(0, 0)]
        pieces = [self._eta(X[rows]) for rows in cuts]
        eta, noise = (np.concatenate(piece, axis=1) for piece in zip(*pieces, strict=True))
        return _possible(eta, noise)

    def _eta(self, X: FloatArray) -> tuple[FloatArray, FloatArray]:
        factors = self.model.factors(X, self.values)
        if self.coefficients.shape[1] and self.model.acts_on("response"):
            # no linear function of the coefficients: as the draws are known it need not be one
            eta, noise = self.model.outputs(X, self.values, self.coefficients)
        elif factors is None:
            known, features, noise = self.model.simulated(X, self.values)
            eta = known + (features @ self.coefficients[..., None])[..., 0]
        else:
            # one product for all draws, without their features
            weighted = factors.of_parameters * self.coefficients
            eta, noise = factors.known + weighted @ factors.of_inputs.T, np.ones((1, 1))
        if self.effect_coefficients.shape[1]:
            columns = self.model.added(X, self.values)
            eta = eta + (columns @ self.effect_coefficients[..., None])[..., 0]
        return eta, np.broadcast_to(noise * self.sigma[:, None], eta.shape)

    def noise_of(self, output: str = "", position: int = 0) -> FloatArray:
        """Return draws of the noise of an output, of a row with the typical error.

        On the scale of eta.

        Parameters
        ----------
        output : str
            Of several outputs the name of one, at some ``position``.
        """
        errors, noise = self.model.errors, self.sigma
        if errors is not None:
            noise = noise * errors.typical[position] / errors.typical[0]
        for k, effect in enumerate(self.model.effects):
            if isinstance(effect, OutputNoise):
                noise = noise * self.estimates(k).get(f"noise of {output}", 1.0)
            elif isinstance(effect, Jitter):
                noise = np.hypot(noise, list(self.estimates(k).values())[position])
        return noise

    def named(self) -> dict[str, FloatArray]:
        """Return draws by name: omega, theta, sigma, coefficients, effect coefficients.

        Where a parameter of the simulation has one of these names, it keeps it, and the other is
        called ``noise_sigma``, ``surrogate_coefficients`` or ``linear_effect_coefficients``.
        """
        out = dict(zip(_names_of(self.model), self.values.T, strict=True))
        errors = self.model.errors
        if self.likelihood.has_scale and not (errors is not None and errors.fixes_sigma):
            out[_free("sigma", "noise", out)] = self.sigma
        if self.coefficients.shape[1]:
            out[_free("coefficients", "surrogate", out)] = self.coefficients
        if self.effect_coefficients.shape[1]:
            out[_free("effect_coefficients", "linear", out)] = self.effect_coefficients
        return out

    def draws_of(self, effect: int) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
        """Return draws of one cause's own parameters and of its coefficients, by name."""
        first = self.model.n_parameters
        theta = {
            name: self.values[:, first + k]
            for k, (owner, name) in enumerate(self.model.theta_names)
            if owner == effect
        }
        if self.model.effects[effect].follows_slope:
            theta[NOISE_SD] = self.sigma
        coefficients = {
            name: self.effect_coefficients[:, k]
            for k, (owner, name) in enumerate(self.model.column_names)
            if owner == effect
        }
        return theta, coefficients

    def thinned(self, most: int = SOME_DRAWS) -> Posterior:
        """Return the posterior with so many of its draws at most, evenly spaced."""
        return self.take(np.linspace(0, self.n_draws - 1, min(self.n_draws, most)).astype(int))

    def estimates(self, effect: int) -> dict[str, FloatArray]:
        """Return the draws that one cause reports, in the user's units."""
        estimates = self.model.effects[effect].estimates(*self.draws_of(effect))
        # what is known, as a row that is left out, is the same in every draw
        return {name: np.broadcast_to(values, self.n_draws) for name, values in estimates.items()}


def _names_of(model: MeasuredModel) -> list[str]:
    """Return readable names of all unknowns, those that clash with a parameter's prefixed."""
    own = [name for _, name in model.theta_names]
    taken = [*model.parameters, *own]
    readable = [
        name if taken.count(name) == 1 else f"{model.effects[k].kind}_{k}_{name}"
        for k, name in model.theta_names
    ]
    names = [*model.parameters, *readable]
    return [*names, *(_free(name, "surrogate", names) for name in model.basis.hyperpriors)]


def _free(name: str, prefix: str, taken: Collection[str]) -> str:
    """Return a name, prefixed where something has it already."""
    return f"{prefix}_{name}" if name in taken else name


def _possible(eta: FloatArray, noise: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return eta and noise (S, n) whose failed draws are those that did not fail, in turn."""
    failed = ~np.isfinite(eta)
    if not failed.any():
        return eta, noise
    count = np.sum(~failed, axis=0)
    lost = int(np.sum(count == 0))
    share = 100 * failed[:, count > 0].mean(axis=0).max(initial=0.0)
    some, n = int(failed.any(axis=0).sum()) - lost, eta.shape[1]
    parts = [
        f"At {some} of {n} rows the simulation fails for up to {number(share, 2)} % of the draws: "
        "they count as impossible there.",
        f"At {lost} of {n} rows every draw fails, and there is no prediction.",
    ]
    warnings.warn(
        " ".join(part for part, rows in zip(parts, (some, lost), strict=True) if rows),
        FailedRunsWarning,
        stacklevel=4,
    )
    good_first = np.argsort(failed, axis=0, kind="stable")
    turn = (np.cumsum(failed, axis=0) - 1) % np.maximum(count, 1)
    draw = np.where(
        failed, np.take_along_axis(good_first, turn, axis=0), np.arange(len(eta))[:, None]
    )
    return np.take_along_axis(eta, draw, axis=0), np.take_along_axis(noise, draw, axis=0)


def with_prior_only(posterior: Posterior, problem: Problem, effects: Sequence[Cause]) -> Posterior:
    """Return a posterior with further effects that nothing was learned about.

    Parameters
    ----------
    posterior : Posterior
    problem : Problem
        That it is the posterior of.
    effects : sequence of Cause
        Not prepared.
    """
    if not effects:
        return posterior
    own, stacking = problem.model, problem.stacking
    scales = () if stacking is None else stacking.scale.tolist()
    context = Context(
        dict(zip(own.columns, problem.X.T, strict=False)),
        own.n_inputs,
        dict(own.parameters),
        {},
        problem.scale,
        outputs=() if stacking is None else stacking.names,
        of_outputs=tuple(OfOutput(0.0, 0.0, 1.0, float(scale)) for scale in scales),
    )
    prepared = [prepared_for(effect, context) for effect in effects]
    model = posterior.model
    whole = model.with_effects((*model.effects, *prepared))
    n, known = posterior.n_draws, model.n_unknowns
    # a separate stream: draws of all else stay the same
    random = np.random.RandomState(0)
    # evenly spread over each prior, in random order
    theta = [prior.ppf((random.permutation(n) + 0.5) / n) for prior in whole.priors[known:]]
    values = np.column_stack([posterior.values[:, :known], *theta, posterior.values[:, known:]])
    q = len(model.column_sd)
    added = random.standard_normal((n, len(whole.column_sd) - q)) * whole.column_sd[q:]
    coefficients = np.hstack([posterior.effect_coefficients, added])
    return replace(posterior, model=whole, values=values, effect_coefficients=coefficients)
