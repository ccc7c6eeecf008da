"""Searches that are stopped, causes that cannot be weighed, simulations that fail."""

import numpy as np
import pytest
from few_kinds import all_but
from scipy.stats import halfnorm, norm, uniform
from searching import compared
from sklearn.base import clone
from sklearn.exceptions import NotFittedError

import hybridsurrogate as hs
from hybridsurrogate.diagnosis.answers.finding import cause_table, form_of
from hybridsurrogate.diagnosis.search.setup import prepare, trained_emulator


def line(t, level, slope):
    return level + slope * t


T = np.linspace(0, 10, 30)
Y = line(T, 1.0, 1.0) + 2.0 * (T > 6) + 0.2 * np.random.default_rng(0).standard_normal(30)


def diagnosis_of(*causes, function=line, **settings):
    simulator = hs.Simulator(function, {"t": (0, 10)}, {"level": norm(0, 3), "slope": norm(1, 0.5)})
    model = hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), n_draws=200, random_state=0
    )
    settings = {"cv": None, "n_replicates": 20, "random_state": 0, **settings}
    return hs.DiscrepancyDiagnosis(model, causes=causes, **settings)


class Own(hs.Cause):
    """A bend whose strength is unknown."""

    kind = "bend"
    target = "t"
    parameters = {"rate": halfnorm(scale=1.0)}
    coefficients = ("amplitude",)

    def columns(self, X, theta):
        return np.sqrt(theta["rate"] * X["t"])[:, None]


class Stopped(Own):
    """Whose user presses Ctrl-C at its first curve after the two checks."""

    calls = 0

    def columns(self, X, theta):
        Stopped.calls += 1
        if Stopped.calls > 2:
            raise KeyboardInterrupt
        return super().columns(X, theta)


def test_an_interrupted_search_keeps_the_causes_already_weighed():
    Stopped.calls = 0
    diagnosis = diagnosis_of(Stopped())
    with (
        pytest.warns(hs.DiagnosisWarning, match="causes had been compared, and causes_ lists them"),
        pytest.raises(KeyboardInterrupt),
    ):
        diagnosis.fit(T[:, None], Y)
    table = diagnosis.causes_
    weighed = table[table["note"] == ""]
    assert {"none", "step", "trend", "bump", "offset"} <= set(weighed["kind"])
    assert weighed["probability"].sum() == pytest.approx(1)
    assert weighed["kind"].iloc[0] == "step"
    (note,) = table[table["kind"] == "bend"]["note"]
    assert note == "not compared: the search was interrupted"
    assert not hasattr(diagnosis, "verdict_")
    with pytest.raises(NotFittedError):
        diagnosis.predict(T[:, None])


def test_an_interrupt_in_the_folds_keeps_everything_but_the_gain(monkeypatch):
    def stop(*arguments):
        raise KeyboardInterrupt

    diagnosis = diagnosis_of(cv=2, exclude=all_but("step", "trend"))
    with monkeypatch.context() as patched:
        patched.setattr("hybridsurrogate.diagnosis.fitting.diagnose.cross_validated", stop)
        with (
            pytest.warns(hs.DiagnosisWarning, match="folds .* were interrupted: there is no gain"),
            pytest.raises(KeyboardInterrupt),
        ):
            diagnosis.fit(T[:, None], Y)
    assert diagnosis.verdict_ in ("named", "ambiguous")
    assert diagnosis.causes_["kind"].iloc[0] == diagnosis.best_cause_.kind
    assert diagnosis.gain_ is diagnosis.gain_out_of_range_ is None
    assert "Is something wrong?" in str(diagnosis.report(full=True))


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.3, 0.35, 0.4, 0.5, 0.7, 0.9])
def test_an_interrupt_at_any_moment_leaves_what_belongs_together(share):
    """Whatever is there afterwards is about all rows, and about one search.

    The share is of the calls of the simulation, of which the first are for the fit before it.
    """
    calls, last = 0, np.inf

    def fading(t, level):
        nonlocal calls
        calls += 1
        if calls > last:
            raise KeyboardInterrupt
        return level * np.exp(-t / 5)

    simulator = hs.Simulator(fading, {"t": (0, 10)}, {"level": uniform(1, 3)})
    model = hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), n_draws=100, random_state=0
    )
    y = 2 * np.exp(-T / 5) + 0.5 * (T > 6) + 0.1 * np.random.default_rng(0).standard_normal(len(T))
    diagnosis = hs.DiscrepancyDiagnosis(model, n_replicates=20, cv=2, random_state=0)
    whole = diagnosis.fit(T[:, None], y).causes_
    calls, last = 0, share * calls
    with pytest.warns(hs.DiagnosisWarning, match="interrupted"), pytest.raises(KeyboardInterrupt):
        diagnosis.fit(T[:, None], y)
    calls, last = 0, np.inf
    table = diagnosis.causes_
    assert len(diagnosis.search_.problem.y) == len(T)
    assert len(table) == len(whole)
    assert table["probability"].sum() == pytest.approx(1)
    if hasattr(diagnosis, "verdict_"):
        assert table["probability"].tolist() == whole["probability"].tolist()


class Flat(Own):
    def columns(self, X, theta):
        return np.sqrt(theta["rate"] * X["t"])


class Broken(Own):
    def columns(self, X, theta):
        return np.full((len(X["t"]), 1), np.nan)


class Shrunk(Own):
    def gain(self, X, theta):
        return np.ones(3)


@pytest.mark.parametrize(
    ("cause", "message"),
    [
        (Flat(), r"The cause 'bend\(t\)' must return shape \(60, 1\) from columns"),
        (Broken(), r"The cause 'bend\(t\)' returned NaN or infinity from columns"),
        (Shrunk(), r"The cause 'bend\(t\)' must return shape \(\) or \(60,\) from gain"),
    ],
)
def test_a_cause_of_the_users_that_is_wrong_is_named(cause, message):
    with pytest.raises(ValueError, match=message):
        diagnosis_of(cause).fit(T[:, None], Y)


class Windy(Own):
    def columns(self, X, theta):
        return (theta["rate"] * X["wind"])[:, None]


@pytest.mark.parametrize(
    ("cause", "kind", "reason"),
    [
        (Windy(), "bend", "it asks for 'wind'; there are ['t', 'level', 'slope']"),
        (hs.Trend("wind"), "trend", "There is no measured column 'wind'"),
        (hs.WrongConstant("ambient"), "wrong-constant", "ambient"),
        (hs.DynamicDrift("slope"), "parameter-drift", "OdeSimulator"),
    ],
)
def test_a_cause_of_the_users_that_lacks_something_is_skipped_with_a_reason(cause, kind, reason):
    with pytest.warns(hs.DiagnosisWarning, match="was not compared"):
        diagnosis = diagnosis_of(cause, exclude=all_but("step", "trend", kind)).fit(T[:, None], Y)
    table = diagnosis.causes_
    notes = table[(table["kind"] == kind) & (table["log_evidence"].isna())]["note"]
    assert any(note.startswith("not compared: ") and reason in note for note in notes)
    assert diagnosis.verdict_ in ("named", "ambiguous")


def test_too_few_distinct_values_are_a_reason_too():
    t = np.repeat([0.0, 5.0, 10.0], 10)
    diagnosis = diagnosis_of(exclude=all_but("step", "offset")).fit(t[:, None], Y)
    notes = diagnosis.causes_.groupby("kind")["note"].unique()
    assert list(notes["step"]) == ["not compared: t has 3 distinct values, 6 are needed"]
    # of all rows, and of those at each of the three values
    assert list(notes["offset"]) == [""]


def half_broken(t, level, slope):
    # a slope below one is a case that this simulation cannot do
    return np.where(slope < 1.0, np.nan, level + slope * t)


def test_parameters_for_which_the_simulation_fails_are_impossible_and_reported():
    y = line(T, 1.0, 1.3) + 0.2 * np.random.default_rng(1).standard_normal(30)
    few = all_but("offset", "trend", "step")
    diagnosis = diagnosis_of(function=half_broken, exclude=few).fit(T[:, None], y)
    assert diagnosis.estimator_.posterior_.values[:, 1].min() >= 1.0
    assert diagnosis.verdict_ == "adequate"
    notes = diagnosis.causes_.set_index("kind")["note"]
    failed = int(notes["none"].split()[4])
    # half of the prior of the slope lies below one: 25 of 50, and three standard errors
    assert abs(failed - 25) <= 11
    assert notes["none"].endswith(
        "of 50 sets of parameters from the priors, which count as impossible"
    )
    assert notes["offset"] == ""


def test_an_equation_that_blows_up_for_some_parameters():
    # n' = rate n^2 leaves every bound at t = 1 / rate
    simulator = hs.OdeSimulator(
        lambda t, state, rate: rate * state**2,
        initial_state=[1.0],
        observe=lambda state: state[0],
        inputs={"t": (0, 1)},
        parameters={"rate": hs.truncated_normal(0.8, 0.4, 0.1, 2.0)},
        states="n",
    )
    t = np.linspace(0.05, 0.95, 24)
    y = 1 / (1 - 0.7 * t) + 0.02 * np.random.default_rng(0).standard_normal(24)
    model = hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), n_draws=100, random_state=0
    )
    model.fit(t[:, None], y)
    assert np.isfinite(model.predict(t[:, None])).all()
    assert abs(model.posterior_.values[:, 0].mean() - 0.7) < 0.02
    table = table_of(model, ("offset", "unexplained"))
    assert "the simulation fails for" in table.set_index("kind")["note"]["none"]
    assert np.isfinite(table["log_evidence"]).all()


def table_of(fitted, forms):
    """Return the table of causes of a search over some forms."""
    prepared = prepare(fitted, ())
    causes = [cause for cause in prepared.causes if form_of(cause) in forms]
    problem, emulator = trained_emulator(prepared.problem, fitted)
    return cause_table(compared(problem, causes, emulator), [])


def test_near_copies_have_forms_of_their_own():
    drifts = [f"parameter-drift: {shape} over t" for shape in ("linear", "logistic")]
    model = clone(diagnosis_of().estimator).fit(T[:, None], Y)
    table = table_of(model, ("trend", "trend: quadratic", *drifts, "unexplained"))
    assert list(table.columns) == [
        *("kind", "target", "form", "probability", "log_evidence", "smooth_curve"),
        *("correlated", "note"),
    ]
    weighed = table[table["note"] == ""]
    assert {"none", "trend", "trend: quadratic", "unexplained"} <= set(weighed["form"])
    assert "parameter-drift: logistic over t" in set(weighed["form"])
    assert not weighed.duplicated(["kind", "target", "form"]).any()
