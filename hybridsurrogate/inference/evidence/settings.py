"""The settings of a search over causes: one place, each number with its meaning or figure."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class SearchSettings:
    """Numbers of the search; evidences and margins in nats, places in standard normal units.

    Attributes
    ----------
    prior_none, prior_unexplained : float
        Prior probabilities; the rest is shared by kinds.
    prior_remainder : float
        Prior probability that a named cause leaves a smooth remainder.
    smallest_size, largest_size, n_sizes : float, float, int
        Prior scales of effects' sizes, log-spaced: from a share of the noise to a few times the
        spread of the output.
    isolated_rows, isolated_odds : float, float
        A shape at a place where less than so many rows carry it is a mechanism with these odds, as
        much else happens to single rows (`GrossError`). Of 60 rows with a wild last one the kinds
        that jump there shared the probability in four.
    grouped_lengths : int
        Groups of neighbouring lengths of a process, each of one evidence, where it is compared
        with another process in addition: 24 of 94 change its evidence by 0.02.
    max_behind : float
        A cause so far behind the best one, prior odds included, is not refined after a first
        optimisation, nor scored by importance sampling. A pair so far behind the best pair gets no
        joint refit. What is so far behind
        in all rows is not compared in some of them: with four nats for pairs, or without those not
        tried in all rows, 2 of 9 cases chose otherwise beyond the data, both worse.
    probed_nodes, probing_rounds : int
        Nodes of a coarse grid between which a cause may fit much better, and rounds of looking:
        needed for noise below a hundredth of the output (tests of precise data).
    refit_noise_ratio : float
        A fit with less than this share of the noise that it was made with is made again: 0.7 nats
        at effects of eight times the noise.
    converged_noise : float
        Noise that a further optimisation lowers by less than this share has converged.
    max_refinements, fruitless_refinements : int
        Refinements of a grid at most; how many in a row may gain nothing: a wave in measurements
        that are precise to a millionth needs all of them.
    resolved_nodes, cell_margin, max_split : int, float, int
        A grid is fine enough with so many nodes an axis within two nats of the best; cells so far
        behind are pruned (at 30 nats the evidence of a curve of any shape is 0.25 nats from that
        of a search that converges further); cells split at a time.
    converged_gain : float
        A smaller gain of an optimisation (minus twice the log density) or of a finer grid is none.
    max_followed : int
        Nodes that are followed where each needs runs of the simulation.
    max_compared : int
        Causes that are compared once more, those that explain most: given correlated noise, scored
        by importance sampling, and second ones refitted together with a first. Such refits name
        both of 77 instead of 69 % of pairs (48 of size 2, 80 rows).
    alternation_rounds : int
        Rounds in which each of several causes may give way to a better one. With the probability
        of each conditional on the others, 37 instead of 12 of these 48 pairs are "named", 89 and
        92 % rightly. And rounds in which the noise of several outputs is estimated anew: in six
        cases the first gained 1.4 to 9 nats for the cause of most evidence, the second up to 0.3,
        further ones less than 0.03. And turns in which each of two causes is placed once.
    naming_level : float
        Probability from which one cause is named: three times that of all alternatives together.
    optimiser_steps, halving_steps : int
        Steps of Gauss-Newton, Levenberg-Marquardt or, with outliers, of EM; and steps between two
        halvings of the places that are followed.
    max_population : int
        Starting places of an optimisation at most, where a run is quick: of eight drifts of a
        frequency by 12 rad seven are named, from 2000 places four.
    """

    prior_none: float = 0.5
    prior_unexplained: float = 0.02
    prior_remainder: float = 0.1
    smallest_size: float = 0.3
    largest_size: float = 3.0
    n_sizes: int = 10
    isolated_rows: float = 2.05
    isolated_odds: float = 0.01
    grouped_lengths: int = 24
    max_behind: float = 12.0
    probed_nodes: int = 8
    probing_rounds: int = 5
    refit_noise_ratio: float = 0.5
    converged_noise: float = 0.1
    max_refinements: int = 12
    fruitless_refinements: int = 4
    resolved_nodes: int = 4
    cell_margin: float = 100.0
    max_split: int = 40
    converged_gain: float = 0.01
    max_followed: int = 16
    max_compared: int = 8
    alternation_rounds: int = 2
    naming_level: float = 0.75
    optimiser_steps: int = 25
    halving_steps: int = 2
    max_population: int = 8000


SETTINGS = SearchSettings()
