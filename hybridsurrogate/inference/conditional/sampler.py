"""Step 2: the measured world given each draw of the surrogate's coefficients.

For every coefficient draw c_s the unknowns (omega, theta, sigma) and the causes' coefficients a
are inferred anew from their original priors and the full likelihood of the measured rows. One
or two parameters go on a grid; more are drawn by importance sampling. Where the posteriors of the
draws are too narrow for shared proposals, each draw has separate ones.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special

from hybridsurrogate.inference.conditional.grid import (
    GRID_NODES,
    OwnDraws,
    grid_draws,
    log_density_of_pairs,
    own_draws,
)
from hybridsurrogate.inference.conditional.pairwise_squares import (
    MeasuredGiven,
    SharedDraws,
    main_directions,
    node_shares,
    one_node_each,
    quality,
    squares_of_factors,
    squares_of_pairs,
)
from hybridsurrogate.inference.sampling.ensembles import Effort, moved_draws
from hybridsurrogate.inference.sampling.hierarchical import standardised
from hybridsurrogate.inference.sampling.importance import (
    Component,
    bent,
    mixture_log_density,
    mixture_points,
    moment_match,
)
from hybridsurrogate.inference.sampling.modes import Gaussian, LogDensity, find_modes
from hybridsurrogate.inference.sampling.settings import MOST_PROPOSALS, SETTINGS
from hybridsurrogate.model.posterior import MIN_EFFECTIVE_EACH
from hybridsurrogate.model.problem import Problem
from hybridsurrogate.model.statistics import prior_log_density, prior_of_unknowns
from hybridsurrogate.numerics.linear_algebra import (
    LARGE_BLOCK,
    NEGLIGIBLE,
    blocks,
    log_det_of,
    nudged_cholesky,
)
from hybridsurrogate.numerics.psis import KHAT_LIMIT
from hybridsurrogate.types import FloatArray


def conditional_draws(
    problem: Problem,
    u: FloatArray,
    c: FloatArray,
    a: FloatArray,
    random_state: np.random.RandomState,
    effort: Effort,
) -> MeasuredDraws:
    """Draw (omega, theta, sigma, a) given each coefficient draw and its hyperparameters.

    Parameters
    ----------
    problem : Problem
    u, c, a : ndarray of shape (S, d), (S, p), (S, q)
        Draws of step 1: unknowns with hyperparameters, coefficients of surrogate and causes.
    random_state : RandomState
    effort : Effort

    Returns
    -------
    MeasuredDraws
    """
    model, m = problem.model, problem.model.n_unknowns
    hyper, sd = u[:, m:-1], model.column_sd

    def log_density(points: FloatArray, chains: NDArray[np.intp]) -> FloatArray:
        z, log_sigma, columns = points[:, :m], points[:, m], points[:, m + 1 :]
        sigma = np.exp(log_sigma)
        values = model.values(np.hstack([z, hyper[chains]]))
        parts = model.parts(problem.X, values)
        eta = parts.known + (parts.features @ c[chains][..., None])[..., 0]
        eta = eta + (parts.columns @ (columns * sd)[..., None])[..., 0]
        with np.errstate(all="ignore"):
            likelihood = model.likelihood_of(problem.likelihood, values)
            density = likelihood.log_density(problem.observed, eta, parts.noise * sigma[:, None])
            prior = problem.noise_prior.logpdf(sigma) + log_sigma
        out = density @ problem.weights + prior + prior_log_density(z) + prior_log_density(columns)
        return np.where(np.isfinite(out), out, -np.inf)

    start = np.hstack([u[:, :m], u[:, -1:], a / sd])
    points, accepted = moved_draws(log_density, start, random_state, effort)
    z, sigma, columns = points[:, :m], np.exp(points[:, m]), points[:, m + 1 :] * sd
    return MeasuredDraws(z, sigma, columns, np.nan, accepted, "moves")


@dataclass(frozen=True)
class MeasuredDraws:
    """Draws of the measured world, one for each coefficient draw.

    Attributes
    ----------
    z : ndarray of shape (S, n_unknowns)
    sigma : ndarray of shape (S,)
    coefficients : ndarray of shape (S, q)
        Coefficients a of the causes.
    khat : float
        Median Pareto shape over draws; minus infinity on a grid, which has no weights.
    effective_draws : float
        Median over draws of the number of nodes that share its weight, or of the moves accepted;
        NaN on a grid.
    method : str
        "grid", "importance" or "moves".
    """

    z: FloatArray
    sigma: FloatArray
    coefficients: FloatArray
    khat: float
    effective_draws: float
    method: str


def second_step(
    problem: MeasuredGiven, first_step: FloatArray, random_state: np.random.RandomState
) -> MeasuredDraws:
    """Draw (omega, theta, sigma, a) given each coefficient draw.

    Parameters
    ----------
    problem : MeasuredGiven
    first_step : ndarray of shape (S, d)
        Draws of u from step 1, around which the proposals should lie.
    random_state : RandomState

    Returns
    -------
    MeasuredDraws
    """
    model = problem.model
    if model.n_unknowns in GRID_NODES and not model.effects:
        u, resolved = grid_draws(problem, _noise_of(first_step), random_state)
        if resolved:
            return _drawn(problem, u, -np.inf, np.nan, "grid", random_state)
        # far from the simulation's guidance each draw has a narrow posterior elsewhere
        own = own_draws(problem, np.stack([u, first_step]), random_state)
        return _drawn(problem, *own, "importance", random_state)
    return _by_proposals(problem, first_step, random_state)


def moved_step(
    problem: MeasuredGiven,
    start: FloatArray,
    random_state: np.random.RandomState,
    effort: Effort,
) -> MeasuredDraws:
    """Draw (omega, theta, sigma, a) given each coefficient draw by moves, from draws near to it.

    No mode is sought: some ten times as fast as `second_step` where coefficient draws are few.

    Parameters
    ----------
    problem : MeasuredGiven
    start : ndarray of shape (S, d)
        u = [z, log sigma] for each coefficient draw.
    random_state : RandomState
    effort : Effort
    """
    density = partial(log_density_of_pairs, problem)
    u, accepted = moved_draws(density, start, random_state, effort)
    return _drawn(problem, u, np.nan, accepted, "moves", random_state)


def _noise_of(first_step: FloatArray) -> float:
    return float(np.exp(np.median(first_step[:, -1])))


def _by_proposals(
    problem: MeasuredGiven,
    first_step: FloatArray,
    random_state: np.random.RandomState,
) -> MeasuredDraws:
    """Weigh proposals that all coefficient draws share, moved to where the mass is."""
    centre = SharedDraws(problem.draws.centre[None])

    def at_centre(u: FloatArray) -> FloatArray:
        return _log_density(problem, u, centre)[:, 0]

    starts = first_step[np.argsort(-at_centre(first_step[:200]))[:2]]
    # step 1 shares the noise with runs that may have next to none
    noisy = np.maximum(starts[:, -1], np.log(problem.scale))
    starts = np.vstack([starts, np.column_stack([starts[:, :-1], noisy])])
    coordinates = standardised(problem.model, at_centre, starts)
    if coordinates is not None:
        first_step, starts = coordinates.of(first_step), coordinates.of(starts)

    plain = _as_is if coordinates is None else coordinates.points
    density: LogDensity = at_centre
    if coordinates is not None:
        density = partial(coordinates.density, at_centre)
    modes = find_modes(density, starts)
    n = max(SETTINGS.oversampling * len(first_step), SETTINGS.min_proposals)
    found = _weighted(
        problem,
        _near_all(first_step, modes[0].log_mass),
        [modes[0]],
        _noise_of(first_step),
        plain,
        min(n, MOST_PROPOSALS),
        random_state,
    )
    u, share, khat, effective = found.u, found.share, found.khat, found.effective
    node = one_node_each(share, random_state)
    drawn = OwnDraws(u[node], khat, effective)
    # separate proposals for each draw take a Hessian each: where fewer shared ones count or, in
    # many dimensions, these are doubtful; never in a hierarchy, whose ridges they do not follow
    many = first_step.shape[1] > SETTINGS.many_dimensions
    least = MIN_EFFECTIVE_EACH if many else SETTINGS.draw_proposals
    if (khat > KHAT_LIMIT or effective < least) and coordinates is None:
        best = u[np.argmax(found.log_density, axis=0)]
        own = own_draws(problem, np.stack([best, plain(first_step)[0]]), random_state)
        drawn = own if own.khat < max(khat, KHAT_LIMIT) else drawn
    return _drawn(problem, *drawn, "importance", random_state)


class _Weighted(NamedTuple):
    """Nodes u (J, d), and of each with each coefficient draw (J, S) log density and share.

    The density (J,) of the proposals is that of u.

    Attributes
    ----------
    khat, effective : float
        Medians over draws.
    """

    u: FloatArray
    log_density: FloatArray
    log_proposal: FloatArray
    share: FloatArray
    khat: float
    effective: float


def near_draws(u: FloatArray, weight: FloatArray) -> Gaussian:
    """Return the Gaussian with the moments of weighted draws (S, d), of all where few weigh."""
    return moment_match(u, weight, _near_all(u))


def _near_all(u: FloatArray, log_mass: float = 0.0) -> Gaussian:
    n, d = u.shape
    return moment_match(u, np.full(n, 1 / n), Gaussian(u[0], np.eye(d), log_mass))


def _weighted(
    problem: MeasuredGiven,
    first: Gaussian,
    others: list[Gaussian],
    sigma: float,
    plain: Callable[[FloatArray], tuple[FloatArray, FloatArray]],
    n: int,
    random_state: np.random.RandomState,
) -> _Weighted:
    """Weigh n proposals that all coefficient draws share, then more, until they suit these.

    Parameters
    ----------
    first, others : Gaussian, list of Gaussian
        Around which proposals are made; the first moves to where the weights are, and bends.
    plain : callable
        From the proposals' coordinates to u, and the log of the volume.
    """
    components: list[Component] = [first, *others]
    for round_ in range(SETTINGS.few_rounds + 1):
        points = mixture_points(components, n, random_state)
        u, log_volume = plain(points)
        log_proposal = mixture_log_density(components, points) - log_volume
        given = main_directions(problem, u[:, :-1], sigma)
        log_density = _log_density(given, u, given.draws)
        log_weight = log_density - log_proposal[:, None]
        share = node_shares(log_weight)
        khat, effective = quality(log_weight, share, 25)
        enough = effective > SETTINGS.min_effective_share * n and khat <= KHAT_LIMIT
        if enough or round_ == SETTINGS.few_rounds:
            break
        weight = share.mean(axis=1)
        moved = moment_match(points, weight, first)
        components = [moved, *others]
        if round_:
            # what moved ones do not serve, such as ten unknowns of experiments, has all of them,
            # and bends
            components += bent(points, weight, [moved])
            n = MOST_PROPOSALS
    return _Weighted(u, log_density, log_proposal, share, khat, effective)


def _as_is(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    return points, np.zeros(len(points))


def held_out(
    others: MeasuredGiven,
    all_rows: MeasuredGiven,
    near: Sequence[Gaussian],
    random_state: np.random.RandomState,
) -> FloatArray | None:
    """Return the log density (S,) of held-out rows given the others and each coefficient draw.

    It is the ratio of the evidence of all rows to that of the others, both from the same
    proposals: the mean density of draws given the others would rest on their tails where rows are
    improbable given them (2 to 17 nats too low for rows at -25 to -32).

    None where the proposals do not serve. The constant of the normal distribution is left out.

    Parameters
    ----------
    others, all_rows : MeasuredGiven
        With the same S coefficient draws.
    near : sequence of Gaussian
        Around what is inferred from the others, and from all rows.
    random_state : RandomState
    """
    sigma, n = float(np.exp(near[0].mean[-1])), SETTINGS.min_proposals
    first, further = near[0], list(near[1:])
    found = _weighted(others, first, further, sigma, _as_is, n, random_state)
    if found.khat > KHAT_LIMIT:
        # half of the proposals lie elsewhere: further rounds take 1 s, moves 6 to 9
        first = moment_match(found.u, found.share.mean(axis=1), first)
        found = _weighted(others, first, further, sigma, _as_is, n, random_state)
    given = main_directions(all_rows, found.u[:, :-1], sigma)
    log_weight = found.log_density - found.log_proposal[:, None]
    with_them = _log_density(given, found.u, given.draws) - found.log_proposal[:, None]
    khat, effective = quality(with_them, node_shares(with_them), 25)
    if max(khat, found.khat) > KHAT_LIMIT:
        return None
    if min(effective, found.effective) < MIN_EFFECTIVE_EACH:
        return None
    ratio: FloatArray = special.logsumexp(with_them, axis=0) - special.logsumexp(log_weight, axis=0)
    return ratio


def exchanged(
    problem: MeasuredGiven, u: FloatArray, n: int, random_state: np.random.RandomState
) -> NDArray[np.intp] | None:
    """Return for each coefficient draw n draws u out of those of all, (S, n) positions.

    Draws of all conditional posteriors together are draws of their mixture, whose density follows
    from the condition that each posterior has mass one (Shirts and Chodera 2008, Journal of
    Chemical Physics 129:124105). None where too few serve each coefficient draw. With 30 moves from
    a single draw in their place leave-one-out scores of six fits were up to 0.016 higher.

    Parameters
    ----------
    problem : MeasuredGiven
        With S coefficient draws.
    u : ndarray of shape (S, d)
        A draw of the posterior of each.
    n : int
    random_state : RandomState
    """
    given = main_directions(problem, u[:, :-1], _noise_of(u))
    log_density = _log_density(given, u, given.draws)
    share = _shares_of_mixture(np.exp(log_density - log_density.max(axis=0)))
    if not np.median(1 / np.sum(share**2, axis=0)) >= MIN_EFFECTIVE_EACH:
        return None
    return np.stack([one_node_each(share, random_state) for _ in range(n)], axis=1)


def _shares_of_mixture(density: FloatArray) -> FloatArray:
    """Return the shares (J, S) in posteriors with such densities of one draw of each of them."""
    share = density / density.sum(axis=0)
    for _ in range(SETTINGS.mode_steps):
        mixture = share.sum(axis=1, keepdims=True)
        share = share / np.where(mixture > 0, mixture, 1.0)
        total = share.sum(axis=0)
        share /= total
        if np.ptp(np.log(total)) < SETTINGS.mode_gain:
            break
    return share


def _drawn(
    problem: MeasuredGiven,
    u: FloatArray,
    khat: float,
    effective: float,
    method: str,
    random_state: np.random.RandomState,
) -> MeasuredDraws:
    columns = _draw_columns(problem, u, random_state)
    return MeasuredDraws(u[:, :-1], np.exp(u[:, -1]), columns, khat, effective, method)


def _log_density(problem: MeasuredGiven, u: FloatArray, draws: SharedDraws) -> FloatArray:
    """Return the log density of proposals (J, d) given coefficient draws (S, p): (J, S)."""
    model, rows = problem.model, problem.features_and_rest
    # rows whose features factorise are not formed for each proposal
    width = 1 + len(model.column_sd) + (len(draws.centre) if rows is None else 0)
    pieces = blocks(len(u), problem.n_rows * width, LARGE_BLOCK)
    return np.concatenate([_log_density_of_some(problem, u[some], draws) for some in pieces])


def _log_density_of_some(problem: MeasuredGiven, u: FloatArray, draws: SharedDraws) -> FloatArray:
    """Return the log density of few proposals.

    The causes' coefficients a ~ N(0, diag(sd^2)) are integrated out by Woodbury's identity.
    """
    model, y = problem.model, problem.y
    sigma = np.exp(u[:, -1])
    values = model.values(u[:, :-1])
    root = np.sqrt(problem.weights)
    rows = problem.features_and_rest
    if rows is None:
        parts = model.parts(problem.X, values)
        scale = parts.noise * sigma[:, None]
        scaled = root / scale
        features = parts.features * scaled[..., None]
        residual = ((y - parts.known) * scaled)[..., None]
        columns = parts.columns * model.column_sd * scaled[..., None]
        total = squares_of_pairs(features, residual, draws)
        right = np.swapaxes(columns, 1, 2) @ np.concatenate([features, residual], axis=2)
    else:
        # rows need not be formed for each proposal
        scale = sigma[:, None]
        of_parameters = problem.parameters_part(values)
        total = squares_of_factors(rows[0], of_parameters, rows[1], draws) / scale**2
        columns = problem.columns(values) / scale[..., None]
        right = np.swapaxes(columns, 1, 2) @ np.column_stack(rows)
        right[..., :-1] *= of_parameters[:, None]
        right /= scale[..., None]
    inner = np.eye(columns.shape[2]) + np.swapaxes(columns, 1, 2) @ columns
    factor = nudged_cholesky(inner)
    if columns.shape[2]:
        # |r|^2 - |F^-1 H' r|^2 with F F' = I + H'H, linear in c
        projected = np.linalg.solve(factor, right)
        total = total - squares_of_pairs(projected[..., :-1], projected[..., -1:], draws)
    prior = prior_of_unknowns(u, problem.noise_prior)
    log_scale = np.log(np.broadcast_to(scale, (len(u), len(y)))) @ problem.weights
    log_det = log_det_of(factor) + log_scale
    rounding = 0.5 * problem.weights.sum() * (NEGLIGIBLE * problem.scale / sigma) ** 2
    out = (prior - log_det - rounding)[:, None] - 0.5 * np.maximum(total, 0.0)
    return np.where(np.isfinite(out), out, -np.inf)


def _draw_columns(
    problem: MeasuredGiven, u: FloatArray, random_state: np.random.RandomState
) -> FloatArray:
    """Draw a given (u_s, c_s), one for each s: (S, q)."""
    q = len(problem.model.column_sd)
    noise = random_state.standard_normal((len(u), q, 1))
    if not q:
        return noise[..., 0]
    pieces = []
    for some in blocks(len(u), problem.n_rows * (1 + q), LARGE_BLOCK):
        residual, columns, _ = problem.of_pairs(u[some], problem.c[some])
        transposed = np.swapaxes(columns, 1, 2)
        factor = nudged_cholesky(np.eye(q) + transposed @ columns)
        half = np.linalg.solve(factor, transposed @ residual[..., None]) + noise[some]
        pieces.append(np.linalg.solve(np.swapaxes(factor, 1, 2), half)[..., 0])
    return np.concatenate(pieces) * problem.model.column_sd
