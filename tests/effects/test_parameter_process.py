"""A parameter that wanders: which one of several, and its course."""

import numpy as np
import pandas as pd
import pytest
from few_kinds import all_but
from scipy.stats import norm

import hybridsurrogate as hs
from hybridsurrogate.estimators.averaged import leading
from hybridsurrogate.numerics import hilbert
from hybridsurrogate.plotting import plot_parameter_course

T = np.linspace(0, 10, 60)
KINDS = all_but("unexplained", "trend")


def output(t, slope, height):
    return slope * t + height * np.sin(t)


def heights_of(t):
    return 3 * np.exp(0.4 * np.sin(0.8 * t))


def diagnosed(y, seed=0, **settings):
    simulator = hs.Simulator(
        output,
        {"t": (0, 10)},
        {"slope": hs.truncated_normal(2, 0.5, 0.5, 4), "height": hs.truncated_normal(3, 1, 0.5, 8)},
    )
    model = hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), n_draws=300, random_state=0
    )
    causes = [hs.ParameterProcess("slope"), hs.ParameterProcess("height")]
    settings = {"cv": None, "n_replicates": 40, "exclude": KINDS, **settings}
    return hs.DiscrepancyDiagnosis(model, causes=causes, random_state=0, **settings).fit(
        T[:, None], y
    )


@pytest.fixture(scope="module")
def found():
    noise = 0.2 * np.random.default_rng(0).standard_normal(len(T))
    return diagnosed(output(T, 2.0, heights_of(T)) + noise)


def test_it_is_known_which_parameter_wanders(found):
    assert found.verdict_ == "named"
    assert (found.best_cause_.kind, found.best_cause_.target) == ("parameter-drift", "height")
    # the output's own curve explains less
    table = found.causes_.set_index("form")["log_evidence"]
    assert table["parameter-drift: process over t"].max() > table["unexplained"]


def test_its_course_is_known(found):
    posterior = leading(found.extended_estimator_).posterior_
    cause, theta = posterior.model.effects[0], posterior.draws_of(0)[0]
    course = cause.course(T, posterior.named()["height"], theta)
    assert course.shape == (posterior.n_draws, len(T))
    low, high = np.quantile(course, [0.05, 0.95], axis=0)
    # neighbours share their error: a band of 90 % may miss a stretch
    assert np.mean((low < heights_of(T)) & (heights_of(T) < high)) > 0.6
    assert np.sqrt(np.mean((course.mean(axis=0) / heights_of(T) - 1) ** 2)) < 0.15


def test_its_course_is_drawn_in_the_report(found, tmp_path):
    course = found.parameter_course()
    assert course["parameter"].unique().tolist() == ["height"]
    assert course["over"].unique().tolist() == ["t"]
    truth = heights_of(course["x"])
    assert np.mean((course["lower"] < truth) & (truth < course["upper"])) > 0.6
    # a constant misses most of the course
    assert np.std(course["mean"] - truth) < 0.5 * np.std(course["constant"] - truth)
    ax = plot_parameter_course(course)
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("t", "height")
    with pytest.raises(ValueError, match="draw one at a time"):
        plot_parameter_course(pd.concat([course, course.assign(parameter="slope")]))
    found.report().save(tmp_path / "course.html")
    page = (tmp_path / "course.html").read_text(encoding="utf-8")
    assert "The parameter height over t with its pointwise 90 % band" in page
    with pytest.raises(ValueError, match="n == 1"):
        found.parameter_course(1)


def test_the_python_code_has_the_course(found):
    space = {}
    exec(found.to_python(), space)
    told = space["extended"](output, T)
    true = output(T, 2.0, heights_of(T))
    assert np.sqrt(np.mean((told - true) ** 2)) < 0.2


def test_nothing_wanders_where_nothing_is_wrong():
    noise = 0.2 * np.random.default_rng(5).standard_normal(len(T))
    diagnosis = diagnosed(output(T, 2.0, 3.0) + noise)
    assert diagnosis.verdict_ == "adequate"
    with pytest.raises(ValueError, match="No parameter wanders"):
        diagnosis.parameter_course()


@pytest.mark.parametrize(
    ("prior", "factor"), [(norm(0, 1), False), (hs.truncated_normal(2, 1, 0, 5), True)]
)
def test_a_parameter_of_one_sign_keeps_it(prior, factor):
    simulator = hs.Simulator(lambda t, p: p * t, {"t": (0, 10)}, {"p": prior})
    model = hs.PowerScaledSurrogate(
        simulator,
        surrogate=hs.ExactSurrogate(),
        effects=[hs.ParameterProcess("p")],
        n_draws=20,
        random_state=0,
    ).fit(T[:, None], 2 * T + np.cos(9 * T))
    assert model.posterior_.model.effects[0].factor is factor


def test_mistakes_are_told():
    for cause, word in [
        (hs.ParameterProcess("hight"), "Did you mean 'height'"),
        (hs.ParameterProcess("height", over="time"), "not an input"),
    ]:
        simulator = hs.Simulator(
            output, {"t": (0, 10)}, {"slope": norm(2, 1), "height": norm(3, 1)}
        )
        model = hs.PowerScaledSurrogate(
            simulator, surrogate=hs.ExactSurrogate(), effects=[cause], random_state=0
        )
        with pytest.raises(ValueError, match=word):
            model.fit(T[:, None], output(T, 2.0, 3.0))


def test_waves_make_a_process_of_unit_variance():
    """In the middle of the range, where the boundary is far for lengths of at most a half."""
    x = np.linspace(-0.5, 0.5, 11)
    for length in (0.3, 0.5):
        factor = hilbert.waves(x, 30) * hilbert.heights(np.array([length]), 30)
        kernel = np.exp(-0.5 * ((x[:, None] - x) / length) ** 2)
        np.testing.assert_allclose(factor @ factor.T, kernel, atol=0.02)
