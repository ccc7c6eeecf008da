"""The settings of posterior sampling: one place, each number with its meaning or figure."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class SamplingSettings:
    """Numbers of importance sampling and of the search for modes.

    Places and distances are in standard normal coordinates, log densities in nats.

    Attributes
    ----------
    oversampling, min_proposals : int
        Proposals for each draw that is kept, and at least: fewer do not estimate k-hat.
    min_effective_share : float
        Draws of a smaller effective share are tried once more, from proposals that bend.
    prior_proposal_share : float
        Share of these that the priors have, next to all others. At the least share of any proposal,
        draws of a noise whose added part may be zero need an ensemble.
    converged_spread : float
        Relative change of standard deviations between two rounds of these at which they are
        steady. Where k-hat alone decides, a fit with two hierarchies takes 22 s instead of 2.
    evidence_starts : int
        Starts from which the modes of an evidence are sought: 148 evidences of counts and heavy
        tails differ by less than 0.3 nats from those from four starts.
    adapted_khat : float
        Rounds of adaptation stop here, and what they do not reach is left to proposals that bend.
        Around bends up to 6.5 % of draws lie beyond an end that should leave 5 % where they stop at
        0.5, up to 5.7 % at 0.3.
    min_mode_share, min_proposed : float
        A mode with less of the best one's mass has no proposals; one of these with less of the
        weight stays where it is, and counts as if it had that; each has at least the second share
        of the points, and a mode with this share of the best one's mass makes a posterior
        multimodal.
    normality_distance : float
        Total variation distance from which on a normal is a poor proposal along a line. Without
        lines, standard deviations of 14 posteriors with steps, episodes or periods are off by 0.05
        instead of 0.03 on average.
    bins, bin_sd : int, float
        Of a piecewise proposal, and points along a line to each side of a mode, the further away
        the further apart (with 200, k-hat of 36 fits differs by 0.003, standard error 0.009); the
        standard deviation of a bin's in widths.
    few_rounds : int
        Starts of a search for modes. And Newton steps, and rounds of adaptation, where proposals
        need no more than about the right place: along a line (without any, standard deviations of
        48 posteriors with steps, episodes or periods are off by 0.004 more, standard error 0.002,
        and one needs an ensemble), given the surrogate's coefficients, and in the smoothing of a
        rough density by its own posterior.
    bending_axes : int
        Axes that all others follow, and their products: with twelve, means and standard deviations
        of 128 densities are as good; where others follow all before them, too, so are those of 112,
        and 37 unknowns take eight times the seconds. And slices of a proposal along its longest
        axis, of so many proposals at most: without, means of 16 fresh densities on bends are off by
        0.030 instead of 0.022 standard deviations.
    converged_noise : float
        Change of the noise, as a share, at which fits that are repeated with their estimated noise
        have converged: with half a drift in data that are precise to a thousandth is not followed.
    mode_steps, mode_gain : int, float
        Steps to a mode at most; gain of the log density, in nats, at which one has reached it: with
        25 steps and ten times the gain, data precise to 1e-5 need an ensemble.
    min_matched_share : float
        Effective share below which moments are matched: with a tenth, means of 300 densities are
        off by 0.046 instead of 0.042 standard deviations.
    ridge_elongation : float
        A mode this many times as long as thick may be the middle of a ridge. In 76 fresh fits of
        an exchange of two unknowns below it, means with and without a ridge differ by 0.8 of their
        errors, and standard deviations are some 2 % smaller without; above 1000 means differ by 0.2
        to 14 standard deviations. Few effective draws are reason enough at any length.
    ridge_spacing, ridge_missed : float
        Of points on a ridge: least distance, and standard deviations by which the next may be
        missed: a spline between them misses a fortieth. It ends at a density of the least share.
    smallest_move : float
        Differential evolution moves by several sizes at once, down to this one: some posteriors are
        as wide as the population, some far narrower.
    ensemble_steps, gaussian_moves : int, float
        Steps of the ensemble between two looks at its convergence, and the share of them that leans
        on the Gaussian approximation.
    node_density_change : float
        Of the log density from a node of the grid over a prior to a point of its cell, at which
        cells are as wide as two standard deviations of the posterior.
    draw_proposals : int
        Given each coefficient draw.
    output_truncation : float
        What leading directions of the coefficients may leave out of an output on average, in
        standard deviations of the noise.
    many_dimensions : int
        Beyond, coefficient draws have separate proposals only where shared ones are doubtful: with
        13 unknowns separate ones took 100 s, shared ones six, with a k-hat of 0.57.
    """

    oversampling: int = 3
    min_proposals: int = 1000
    min_effective_share: float = 0.1
    prior_proposal_share: float = 0.2
    converged_spread: float = 0.05
    evidence_starts: int = 2
    adapted_khat: float = 0.3
    min_mode_share: float = 1e-3
    min_proposed: float = 0.05
    normality_distance: float = 0.25
    bins: int = 40
    bin_sd: float = 0.6
    few_rounds: int = 4
    bending_axes: int = 4
    converged_noise: float = 0.7
    mode_steps: int = 40
    mode_gain: float = 1e-3
    min_matched_share: float = 0.2
    ridge_elongation: float = 300.0
    ridge_spacing: float = 0.1
    ridge_missed: float = 4.0
    smallest_move: float = 0.03
    ensemble_steps: int = 200
    gaussian_moves: float = 0.7
    node_density_change: float = 0.5
    draw_proposals: int = 60
    output_truncation: float = 3e-3
    many_dimensions: int = 10


SETTINGS = SamplingSettings()
# that are weighted together with all coefficient draws in one round at most; and of the first round
# of those that bend
MOST_PROPOSALS = SETTINGS.oversampling * SETTINGS.min_proposals
