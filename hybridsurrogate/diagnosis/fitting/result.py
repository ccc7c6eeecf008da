"""All that a fit found, in one object: report, Python module, folds and user read it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from hybridsurrogate.diagnosis.answers.discrepancy import Discrepancy
from hybridsurrogate.diagnosis.answers.experimental_design import NextMeasurement
from hybridsurrogate.diagnosis.answers.finding import CauseFinding
from hybridsurrogate.diagnosis.checks.caution import Caution
from hybridsurrogate.diagnosis.checks.parameters import Settings
from hybridsurrogate.diagnosis.checks.simulation import EmulatorCheck
from hybridsurrogate.diagnosis.search.forward_selection import SearchStep
from hybridsurrogate.diagnosis.search.null_test import NullTest
from hybridsurrogate.diagnosis.search.residuals import ResidualCheck
from hybridsurrogate.diagnosis.search.search import Search
from hybridsurrogate.diagnosis.validation.beta_scan import BetaScans
from hybridsurrogate.diagnosis.validation.gain import HeldOutGain
from hybridsurrogate.estimators.averaged import AveragedSurrogate
from hybridsurrogate.estimators.power_scaled import PowerScaledSurrogate
from hybridsurrogate.inference.procedure import AtPriorEnd
from hybridsurrogate.model.rows.measured_data import GivenRows
from hybridsurrogate.simulation.simulator import Simulator


@dataclass(frozen=True)
class Conclusion:
    """What a finished search amounts to.

    Attributes
    ----------
    verdict : {"adequate", "named", "nearest", "ambiguous", "unexplained", "undecided"}
    concerns : {"simulation", "noise", "inputs", "data", "prior"} or None
        What is at fault; None where nothing is, or the data cannot decide.
    undecided_by : {"runs", "rows", "prior"} or None
        Of an undecided verdict: what does not suffice.
    same_curve : tuple of str
        Other kinds that draw the same curve through these rows as the most probable cause.
    share : float
        Probability of the most probable kind and of these, given that something is wrong.
    probability_right : float or None
        Probability that this cause is the right one, causes outside the catalogue counted too.
    residual_check : ResidualCheck or None
        Of the residuals of the last accepted cause.
    smallest_detectable : float or None
        Where nothing was detected: the smallest fault that would have been.
    detectable : pandas.DataFrame or None
        The same of each kind.
    """

    verdict: str
    concerns: str | None = None
    undecided_by: str | None = None
    same_curve: tuple[str, ...] = ()
    share: float = 0.0
    probability_right: float | None = None
    residual_check: ResidualCheck | None = None
    smallest_detectable: float | None = None
    detectable: pd.DataFrame | None = None


# what a diagnosis shows of its conclusion
_PUBLIC = (
    "verdict",
    "concerns",
    "undecided_by",
    "probability_right",
    "residual_check",
    "smallest_detectable",
    "detectable",
)


@dataclass(frozen=True, eq=False)
class Extension:
    """The model after, and what it says about the causes.

    Attributes
    ----------
    estimator : AveragedSurrogate or PowerScaledSurrogate
        Fitted; that before where nothing was detected.
    simulator : Simulator or None
        The simulation with the causes in it.
    found_causes : tuple of CauseFinding
        In the order of acceptance.
    discrepancies : dict of output to Discrepancy
        The smooth discrepancy of each output.
    discrepancy : Discrepancy
        That of the output which the first cause concerns.
    confounded : pandas.DataFrame
        How each cause and each parameter depend on each other.
    at_prior_end : tuple of AtPriorEnd
        Parameters that the data push against an end of their prior.
    beta_scans : BetaScans
        Scores over the weight of the simulation, tried when they are first asked for.
    """

    estimator: AveragedSurrogate | PowerScaledSurrogate
    simulator: Simulator | None
    found_causes: tuple[CauseFinding, ...]
    discrepancies: dict[str, Discrepancy]
    discrepancy: Discrepancy
    confounded: pd.DataFrame
    at_prior_end: tuple[AtPriorEnd, ...]
    beta_scans: BetaScans

    def __repr__(self) -> str:
        return f"Extension({', '.join(one.kind for one in self.found_causes)})"

    @property
    def best_cause(self) -> CauseFinding:
        """The first of the accepted causes."""
        return self.found_causes[0]


@dataclass(frozen=True, eq=False)
class DiagnosisResult:
    """All that one fit found; it never changes, and what is added later makes another one.

    Attributes
    ----------
    settings : Settings
        Of this fit.
    rows : GivenRows
        Measured, those without a measurement left out.
    fold_random : RandomState
        The state from which folds are drawn.
    before : PowerScaledSurrogate
        The model before, fitted.
    steps : tuple of SearchStep
        One for each search, each given the causes that were accepted before it.
    causes : pandas.DataFrame
        All causes, most probable first.
    indistinguishable : tuple of str
        Kinds that together reach 90 % probability, given that something is wrong.
    asked : Search
        The search whose alternatives a further measurement would best separate.
    next_measurement : NextMeasurement
        Where that measurement is, and how much it informs.
    emulator_check : EmulatorCheck or None
        How well the runs determine the simulation; None where it is run itself.
    conclusion : Conclusion
        The verdict.
    extension : Extension
        The model after.
    cautions : tuple of Caution
        Reasons to doubt the verdict.
    gain, gain_out_of_range : HeldOutGain or None
        Within the measured range and beyond it; None without folds.
    refinement : pandas.DataFrame or None
        The rounds of `refine`, where it made this result.
    """

    settings: Settings
    rows: GivenRows
    fold_random: np.random.RandomState
    # Any: the class allows an estimator without a simulation, a diagnosis does not
    before: Any
    steps: tuple[SearchStep, ...]
    causes: pd.DataFrame
    indistinguishable: tuple[str, ...]
    asked: Search
    next_measurement: NextMeasurement
    emulator_check: EmulatorCheck | None
    conclusion: Conclusion
    extension: Extension
    cautions: tuple[Caution, ...]
    gain: HeldOutGain | None = None
    gain_out_of_range: HeldOutGain | None = None
    refinement: pd.DataFrame | None = None

    def __repr__(self) -> str:
        found = ", ".join(step.chosen.kind for step in self.steps)
        return f"DiagnosisResult({found}; {len(self.steps)} steps, p = {self.test.p_value:.3g})"

    @property
    def search(self) -> Search:
        """The first search, given no other cause."""
        return self.steps[0].search

    @property
    def test(self) -> NullTest:
        """The test of the first search."""
        test = self.steps[0].test
        assert test is not None  # only folds have none
        return test

    @property
    def place(self) -> dict[str, Any]:
        """Where to measure next: of a column of names the name."""
        names, place = self.before.data_.experiments.labels, self.next_measurement.place
        return {k: names[k][int(x)] if k in names else x for k, x in place.items()}

    def attributes(self) -> dict[str, Any]:
        """Return the public attributes of a fitted diagnosis."""
        said, after = self.conclusion, self.extension
        names = getattr(self.before, "feature_names_in_", None)
        return {
            "n_features_in_": self.before.n_features_in_,
            **({} if names is None else {"feature_names_in_": names}),
            "result_": self,
            "estimator_": self.before,
            "search_": self.search,
            "p_value_": self.test.p_value,
            "causes_": self.causes,
            "indistinguishable_": list(self.indistinguishable),
            "emulator_check_": self.emulator_check,
            "next_measurement_": self.place,
            "next_information_": self.next_measurement.information,
            **{f"{name}_": getattr(said, name) for name in _PUBLIC},
            "extended_estimator_": after.estimator,
            "extended_simulator_": after.simulator,
            "best_cause_": after.best_cause,
            "found_causes_": list(after.found_causes),
            "discrepancies_": after.discrepancies,
            "discrepancy_": after.discrepancy,
            "confounded_": after.confounded,
            "at_prior_end_": list(after.at_prior_end),
            "beta_scans_": after.beta_scans,
            "cautions_": list(self.cautions),
            "gain_": self.gain,
            "gain_out_of_range_": self.gain_out_of_range,
            **({} if self.refinement is None else {"refinement_": self.refinement}),
        }
