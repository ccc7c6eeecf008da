"""Reasons to doubt a verdict, and the thresholds from which checks report them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple


class Caution(NamedTuple):
    """A reason to doubt the verdict.

    Attributes
    ----------
    about : {"data", "columns", "prior", "runs", "rows", "noise", "simulation"}
        Where to look first: single measurements, the table's columns and units, priors of
        parameters, runs of the simulation, too few rows, the likelihood, the simulation itself.
    sentence : str
        What is the matter, then what to do; complete sentences.
    """

    about: str
    sentence: str


@dataclass(frozen=True)
class CheckSettings:
    """Numbers of the checks before and after a search.

    Attributes
    ----------
    least_rows : int
        Measured rows that a diagnosis needs, and pairs of them that a test of their scatter needs.
    search_runs, fold_share : int, float
        Sets of parameters that a search runs (25 000 and 107 000 with five folds at two parameters
        and 50 rows, 33 000 to 112 000 in other cases), and those of a fold in shares of it.
    chance_sd : float
        Standard deviations that a difference has by chance. And rows that agree: one or two may
        by chance where the output is rounded. And floors of the noise: what a search leaves open
        by a few of them is no better known.
    nearly_all, majority : float
        Shares, cosines and correlations from which nearly all, or as much as not, is meant: rows
        within a range by which another unit or an exchange of columns explains it; the range that
        a unit fills, of what another one fills; rows that an exchange must bring into the ranges;
        the cosine of outputs of one shape, or of the other sign; what two rows carry of an effect;
        the correlation from which an estimate's variance is more than five times what it were with
        the parameter known. And rows outside a range from which nothing is diagnosed; noise that
        other columns must leave at most; the width of its prior that a parameter keeps where data
        inform it little; the share of a cause's curve below which only part of it, such as its
        level, goes with a parameter; the probability from which the
        report states a smooth curve in addition to the causes, or the closest match as the fault.
    copy_rounding, copy_correlation : float
        A column whose correlation with the output is so little below one is the output; one above
        the second looks like it.
    unit_factor, unit_tolerance : float
        The factor between measured and simulated output from which the unit looks wrong; one this
        near a unit's, in logarithms, is called by its name.
    outlying_sd, outlying_share : float
        Robust standard deviations of the residuals beyond which a row is far off, and the share of
        the rows that may be without being a pattern.
    jump_share : float
        Jumps of this share of the noise hide effects.
    """

    least_rows: int = 8
    search_runs: int = 30_000
    fold_share: float = 0.65
    chance_sd: float = 3.0
    nearly_all: float = 0.9
    majority: float = 0.5
    copy_rounding: float = 1e-9
    copy_correlation: float = 0.9999
    unit_factor: float = 5.0
    unit_tolerance: float = 0.15
    outlying_sd: float = 10.0
    outlying_share: float = 0.02
    jump_share: float = 0.25


SETTINGS = CheckSettings()
# of noise, behind a p-value
REPLICATES = 999
