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
    large_batch : int
        At least so many where draws are tried once more: far fewer than an ensemble's steps.
    enough_effective : float
        Draws of a smaller effective share are tried once more, from wider proposals.
    prior_proposed : float
        Share of these that the priors have, of that of the wider ones.
    mode_share, proposal_share : float
        Share of the best mode's mass from which a further one makes a posterior multimodal, and
        from which it has separate proposals.
    evidence_starts : int
        Starts from which the modes of an evidence are sought: 148 evidences of counts and heavy
        tails differ by less than 0.3 nats from those from four starts.
    good_khat : float
        Rounds of adaptation stop here. Around bends up to 6.5 % of draws lie beyond an end that
        should leave 5 % where they stop at 0.5, up to 5.7 % at 0.3.
    fewest_near, slices : int
        Fewer points near a mode do not estimate it; of so many proposals each is cut into as many
        slices, of more none. Without, 40 instead of 23 of 232 such densities have a bad k-hat.
    least_share, least_proposed : float
        A proposal with less of the weight stays where it is, and counts as if it had that; each has
        at least this share of the points.
    shaping : float
        Effective points, for each dimension, from which a proposal is shaped: fewer are evened out
        by a power of their weights. As they are, evidences of 142 bent, skewed and heavy-tailed
        densities are off by 0.30 nats on average instead of 0.16.
    proposal_halvings : int
        Halvings that find this power.
    prior_end : float
        No prior has mass beyond.
    windows, window_points : int
        Along a line: windows around the mode, each twice as wide as the one before.
    far_from_normal : float
        Total variation distance from which on a normal is a poor proposal along a line.
    bins, bin_sd : int, float
        Of a piecewise proposal; the standard deviation of a bin's in widths.
    even_points : int
        Points evenly over the prior of a line, about as close as rows are.
    steep, line_deep, line_halvings : float, float, int
        Between two points whose log densities differ by more, none far below the best, is a third.
    followed_nodes, following_steps : int
        Nodes from which the other unknowns are followed first, and steps uphill in them.
    max_starts, converged_noise : int, float
        Starts of a search for modes; and the change of the noise, as a share, at which fits that
        are repeated with their estimated noise have converged.
    mode_steps, mode_rounding : int, float
        Steps to a mode; log densities that differ by less are equal.
    max_transforms, enough_matched : int, float
        Moment matching: transformations, and the effective share below which one is tried.
    ridge_elongation : float
        A mode this many times as long as thick may be the middle of a ridge. In 76 fresh fits of
        an exchange of two unknowns below it, means with and without a ridge differ by 0.8 of their
        errors, and standard deviations are some 2 % smaller without; above 1000 means differ by 0.2
        to 14 standard deviations. Few effective draws are reason enough at any length.
    ridge_spacing, ridge_share, ridge_deep, ridge_near, ridge_missed : float, float, float, int
        Of points on a ridge: least distance in standard deviations of the prior and of the
        approximation, depth at which it ends, points through which the next is extrapolated, and
        standard deviations by which it may be missed: a spline between them misses a fortieth.
    smallest_move : float
        Differential evolution moves by several sizes at once, down to this one: some posteriors are
        as wide as the population, some far narrower.
    ensemble_steps, gaussian_moves : int, float
        Steps of the ensemble between two looks at its convergence, and the share of them that leans
        on the Gaussian approximation.
    prior_reach, node_change : float
        The grid over the prior of a parameter, and the change of the log density from a node to a
        point of its cell at which cells are as wide as two standard deviations of the posterior.
    proposals_each, follow_steps : int
        Given each parameter: proposals, and steps to the mode of those with enough of the weight.
    nodes_together : int
        The fewest nodes whose matrices are worked on together.
    output_left_out, few_coefficients : float, int
        What leading directions of the coefficients may leave out of an output on average, in
        standard deviations of the noise; fewer coefficients are few.
    direction_nodes, direction_rows : int
        Nodes, and their rows, that are asked for these directions.
    conditional_proposals, conditional_rounds : int
        Proposals of a parameter in each round at most, and rounds.
    many_dimensions : int
        Beyond, coefficient draws have separate proposals only where shared ones are doubtful: with
        13 unknowns separate ones took 100 s, shared ones six, with a k-hat of 0.57.
    newton_steps, newton_tolerance : int, float
        To the inner mode, which shapes proposals only: a thousandth of a nat is near enough.
    width_steps, width_rounds : int
        Steps before the smoothing of a rough density is matched to its own posterior; how often.
    direction_share : float
        A direction that moves the linear predictor by a smaller share of the first one is left to
        its prior.
    """

    oversampling: int = 3
    min_proposals: int = 1000
    large_batch: int = 12_000
    enough_effective: float = 0.1
    prior_proposed: float = 0.2
    mode_share: float = 0.02
    proposal_share: float = 1e-5
    evidence_starts: int = 2
    good_khat: float = 0.3
    fewest_near: int = 25
    slices: int = 4
    least_share: float = 1e-3
    least_proposed: float = 0.05
    shaping: float = 10.0
    proposal_halvings: int = 12
    prior_end: float = 6.5
    windows: int = 14
    window_points: int = 33
    far_from_normal: float = 0.25
    bins: int = 40
    bin_sd: float = 0.6
    even_points: int = 256
    steep: float = 0.5
    line_deep: float = 8.0
    line_halvings: int = 5
    followed_nodes: int = 64
    following_steps: int = 4
    max_starts: int = 5
    converged_noise: float = 0.7
    mode_steps: int = 40
    mode_rounding: float = 1e-2
    max_transforms: int = 6
    enough_matched: float = 0.2
    ridge_elongation: float = 300.0
    ridge_spacing: float = 0.1
    ridge_share: float = 0.5
    ridge_deep: float = 12.0
    ridge_near: int = 4
    ridge_missed: float = 4.0
    smallest_move: float = 0.03
    ensemble_steps: int = 200
    gaussian_moves: float = 0.7
    prior_reach: float = 7.0
    node_change: float = 0.5
    proposals_each: int = 60
    follow_steps: int = 20
    nodes_together: int = 50
    output_left_out: float = 3e-3
    few_coefficients: int = 30
    direction_nodes: int = 100
    direction_rows: int = 20_000
    conditional_proposals: int = 3000
    conditional_rounds: int = 4
    many_dimensions: int = 10
    newton_steps: int = 60
    newton_tolerance: float = 1e-3
    width_steps: int = 4
    width_rounds: int = 3
    direction_share: float = 1e-6


SETTINGS = SamplingSettings()
