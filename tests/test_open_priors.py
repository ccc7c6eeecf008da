"""Priors of any support, and with tails too heavy for a standard deviation."""

from __future__ import annotations

import numpy as np
import pytest
from few_kinds import all_but
from scipy import stats

import hybridsurrogate as hs
from hybridsurrogate.priors import period_range, prior_sd

T = np.linspace(0.5, 30, 40)


def decay(t, a, k):
    return a * np.exp(-k * t)


def swing(t, a):
    return a * np.cos(t)


PARAMETERS = {
    "a": hs.truncated_normal(5, 1, 1, 9),
    "k": hs.truncated_normal(0.1, 0.03, 0.02, 0.3),
}


def diagnosed(y, *causes, function=decay, parameters=PARAMETERS):
    simulator = hs.Simulator(function, inputs={"t": (0, 30)}, parameters=parameters)
    model = hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), n_draws=300, random_state=0
    )
    noise = 0.1 * np.random.default_rng(0).standard_normal(len(T))
    # of all kinds `test_a_period_of_any_prior` finds the right one
    few = all_but("step", "bump", "parameter-drift", "trend", "ramp", "noise")
    exclude = () if "periodic" in {one.kind for one in causes} else few
    settings = {"exclude": exclude, "cv": None, "random_state": 0}
    return hs.DiscrepancyDiagnosis(model, causes=causes, **settings).fit(T[:, None], y + noise)


@pytest.mark.slow
@pytest.mark.parametrize(
    "prior", [stats.norm(12, 1), stats.lognorm(0.2, scale=12), stats.halfnorm(scale=15)]
)
def test_a_period_of_any_prior(prior):
    wave = 0.4 * np.sin(2 * np.pi * T / 12)
    best = diagnosed(decay(T, 5, 0.1) + wave, hs.Periodic("t", period=prior)).best_cause_
    assert best.kind == "periodic"
    assert best.estimates["period"][0] == pytest.approx(12, abs=0.5)


@pytest.mark.parametrize("prior", [stats.norm(14, 3), stats.t(3, 14, 3)])
@pytest.mark.parametrize(("form", "kind"), [(hs.Step, "step"), (hs.Bump, "bump")])
def test_a_place_of_any_prior(form, kind, prior):
    shape = T > 15 if kind == "step" else np.exp(-0.5 * ((T - 15) / 2) ** 2)
    best = diagnosed(decay(T, 5, 0.1) + 0.8 * shape, form("t", location=prior)).best_cause_
    assert best.kind == kind
    assert best.estimates["location"][0] == pytest.approx(15, abs=0.8)


@pytest.mark.parametrize("a", [stats.t(2, 5, 0.7), stats.cauchy(5, 0.5)])
def test_a_drifting_parameter_of_any_prior(a):
    """Without a standard deviation."""
    found = diagnosed(swing(T, 5 + 0.1 * (T - 15)), function=swing, parameters={"a": a})
    compared = found.causes_[~found.causes_["note"].str.startswith("not compared")]
    assert np.isfinite(compared.loc[compared["kind"] == "parameter-drift", "log_evidence"]).all()
    assert found.best_cause_.kind == "parameter-drift"


def test_ends_of_periods_and_sizes_of_priors():
    assert period_range(stats.loguniform(2, 30)) == pytest.approx((2, 30))
    assert period_range(stats.lognorm(0.2, scale=12)) == pytest.approx(
        (12 * np.exp(-0.2 * 3.0902), 12 * np.exp(0.2 * 3.0902)), rel=1e-4
    )
    with pytest.raises(ValueError, match=r"A period is positive.*loguniform"):
        period_range(stats.norm(1, 1))
    assert prior_sd(stats.norm(3, 2)) == pytest.approx(2)
    # quartile-like: tan(0.34 pi)
    assert prior_sd(stats.cauchy(0, 1)) == pytest.approx(np.tan(0.34 * np.pi))
