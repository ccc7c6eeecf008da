"""How much weight the simulation deserves, before and after its fault is named."""

import pickle

import numpy as np
import pytest
from pandas.testing import assert_frame_equal
from scipy.stats import norm
from sklearn.base import clone

import hybridsurrogate as hs
from hybridsurrogate.datasets import make_log_sin
from hybridsurrogate.diagnosis.validation.beta_scan import best_beta, scan_beta
from hybridsurrogate.diagnosis.validation.cross_validation import random_folds
from hybridsurrogate.effects.context import Axis
from hybridsurrogate.model.rows.measured_data import GivenRows


def line(t, level, slope):
    return level + slope * t


@pytest.mark.slow
def test_trust_rises_once_the_fault_is_named():
    simulator = hs.Simulator(line, {"t": (0, 14)}, {"level": norm(0, 3), "slope": norm(1, 0.5)})
    rng = np.random.default_rng(0)
    t = np.sort(rng.uniform(0, 14, 40))
    y = line(t, 1.0, 1.0) + 3 * (t - 5) ** 2 / 20 + 0.3 * rng.standard_normal(40)
    before = hs.PowerScaledSurrogate(
        simulator.run(64, random_state=0),
        surrogate=hs.PolynomialChaos(degree=2),
        n_draws=200,
        random_state=0,
    )
    parabola = hs.Trend("t", degree=2, axis=Axis.of([0.0, 14.0]))
    after = clone(before).set_params(effects=(parabola,))
    betas = np.array([0.05, 0.5, 0.9])
    rows = GivenRows(t[:, None], y)
    scan = scan_beta((before, after), betas, random_folds(40, 2, 0), rows, None)
    assert list(scan.columns) == ["beta", "before", "after", "before_error", "after_error"]
    first, then = best_beta(scan, "before"), best_beta(scan, "after")
    assert first < then
    # the best differs from itself by nothing
    at = scan.set_index("beta")
    assert at.loc[first, "before_error"] == at.loc[then, "after_error"] == 0
    assert (scan["before_error"] > 0).sum() == (scan["after_error"] > 0).sum() == 2
    # with most of the weight on the runs, a straight line cannot follow the bend
    assert scan["after"].iloc[-1] > scan["before"].iloc[-1] + 0.5
    # however many processes share the folds
    shared = scan_beta((before, after), betas, random_folds(40, 2, 0), rows, 2)
    assert_frame_equal(scan, shared, rtol=1e-9)


@pytest.mark.slow
def test_the_gain_says_by_how_much_the_simulation_is_worth_more():
    # case study 1 of the paper: the simulation lacks a wave, its best weight is small without it
    case = make_log_sin(random_state=0)
    surrogate = hs.PolynomialChaos(degree=7)
    model = hs.PowerScaledSurrogate(
        case.simulation, surrogate=surrogate, n_draws=300, random_state=0
    )
    diagnosis = hs.DiscrepancyDiagnosis(model, cv=2, random_state=0).fit(case.X, case.y)
    scans = diagnosis.beta_scans_
    assert scans.best_beta_after(out_of_range=True) > scans.best_beta_before(out_of_range=True)
    scan = diagnosis.beta_scan()
    assert len(scan) == len(diagnosis.beta_scan(out_of_range=True)) == 5
    # the largest weight that costs less than a hundredth of a nat
    for word, best in (("before", scans.best_beta_before), ("after", scans.best_beta_after)):
        assert best() == scan["beta"][scan[word] > scan[word].max() - 0.01].max()
    # scans that were stored know it, too, and those that were kept stay those of their fit
    assert pickle.loads(pickle.dumps(scans)).best_beta_after() == scans.best_beta_after()
    scan = scans.few(True)
    diagnosis.set_params(cv=None).fit(case.X, case.y)
    assert scans.few(True) is scan
