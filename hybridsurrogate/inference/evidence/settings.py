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
    few_rows, few_rows_odds : float, float
        A shape at a place where less than so many rows carry it is a mechanism with these odds, as
        much else happens to single rows (`GrossError`). Of 60 rows with a wild last one the kinds
        that jump there shared the probability in four.
    lengths_with_process : int
        Groups of neighbouring lengths of a process, each of one evidence, where it is compared
        with another process in addition: 24 of 94 change its evidence by 0.02.
    behind : float
        A cause so far behind the best one, prior odds included, is not refined after a first
        optimisation, nor scored by importance sampling. A pair so far behind the best pair gets no
        joint refit. What is so far behind
        in all rows is not compared in some of them: with four nats for pairs, or without those not
        tried in all rows, 2 of 9 cases chose otherwise beyond the data, both worse.
    looked_between, looks : int
        Nodes of a coarse grid between which a cause may fit much better, and rounds of looking:
        needed for noise below a hundredth of the output (tests of precise data).
    much_closer : float
        A fit with less than this share of the noise that it was made with is made again: 0.7 nats
        at effects of eight times the noise.
    converged_noise : float
        Noise that a further optimisation lowers by less than this share has converged.
    max_refinements, fruitless_refinements : int
        Refinements of a grid at most; how many in a row may gain nothing: a wave in measurements
        that are precise to a millionth needs all of them.
    nodes_enough, cell_pruned, most_split : int, float, int
        A grid is fine enough with so many nodes an axis within two nats of the best; cells so far
        behind are pruned (at 30 nats the evidence of a curve of any shape is 0.25 nats from that
        of a search that converges further); cells split at a time.
    gain_converged : float
        A smaller gain of an optimisation (minus twice the log density) or of a finer grid is none.
    nodes_followed : int
        Nodes that are followed where each needs runs of the simulation.
    most_compared : int
        Causes that are compared once more, those that explain most: given correlated noise, scored
        by importance sampling, and second ones refitted together with a first. Such refits name
        both of 77 instead of 69 % of pairs (48 of size 2, 80 rows).
    looked_ahead : int
        First causes for which the best second causes are searched.
    rounds : int
        Rounds in which each of several causes may give way to a better one. With the probability
        of each conditional on the others, 37 instead of 12 of these 48 pairs are "named", 89 and
        92 % rightly. And rounds in which the noise of several outputs is estimated anew: in six
        cases the first gained 1.4 to 9 nats for the cause of most evidence, the second up to 0.3,
        further ones less than 0.03. And turns in which each of two causes is placed once.
    named : float
        Probability from which one cause is named: three times that of all alternatives together.
    optimiser_steps, steps_a_round : int
        Steps of Gauss-Newton, Levenberg-Marquardt or, with outliers, of EM; and steps between two
        halvings of the places that are followed.
    widest_population : int
        Starting places of an optimisation at most, where a run is quick: of eight drifts of a
        frequency by 12 rad seven are named, from 2000 places four.
    """

    prior_none: float = 0.5
    prior_unexplained: float = 0.02
    prior_remainder: float = 0.1
    smallest_size: float = 0.3
    largest_size: float = 3.0
    n_sizes: int = 10
    few_rows: float = 2.05
    few_rows_odds: float = 0.01
    lengths_with_process: int = 24
    behind: float = 12.0
    looked_between: int = 8
    looks: int = 5
    much_closer: float = 0.5
    converged_noise: float = 0.1
    max_refinements: int = 12
    fruitless_refinements: int = 4
    nodes_enough: int = 4
    cell_pruned: float = 100.0
    most_split: int = 40
    gain_converged: float = 0.01
    nodes_followed: int = 16
    most_compared: int = 8
    looked_ahead: int = 4
    rounds: int = 2
    named: float = 0.75
    optimiser_steps: int = 25
    steps_a_round: int = 2
    widest_population: int = 8000


SETTINGS = SearchSettings()
