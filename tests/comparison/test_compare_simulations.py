"""Several simulations of the same measurements: which is favoured, and what each lacks."""

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import quad
from scipy.stats import halfnorm, multivariate_normal, norm

import hybridsurrogate as hs
from hybridsurrogate.inference.loo import stacking_weights

T = np.linspace(0, 9, 40)
NOISE = 0.2
X = pd.DataFrame({"t": T, "load": np.cos(5 * T)})


def line(t, rate):
    return rate * t


def root(t, gain, level):
    return level + gain * np.sqrt(t)


def loaded(t, load, rate):
    return rate * t + load


def model_of(function, inputs=("t",), output="y", likelihood="normal", **priors):
    ranges = {"t": (0, 9), "load": (-1, 1)}
    simulator = hs.Simulator(
        function,
        inputs={name: ranges[name] for name in inputs},
        parameters=priors or {"rate": norm(1, 1)},
        output=output,
    )
    return hs.PowerScaledSurrogate(
        simulator, surrogate=hs.ExactSurrogate(), likelihood=likelihood, random_state=0
    )


def roots():
    return model_of(root, gain=norm(2, 1), level=norm(0, 1))


def measured(seed, mean):
    return mean + NOISE * np.random.default_rng(seed).standard_normal(len(T))


@pytest.fixture(scope="module")
def found():
    """The root is right."""
    return hs.compare_simulations(
        [model_of(line), roots()], X[["t"]], measured(0, 2 * np.sqrt(T)), random_state=0
    )


def test_the_right_one_is_chosen(found):
    assert found.chosen == "root"
    assert found.table.index.tolist() == ["root", "line"]
    assert found.table.loc["root", "difference"] == 0.0
    row = found.table.loc["line"]
    assert row["difference"] < -3 * row["difference_error"] < 0
    assert found.table["weight"].sum() == pytest.approx(1.0)
    assert found.table.loc["root", "weight"] > 0.95
    assert found.table.loc["line", "verdict"] != "adequate"
    assert found.all_wrong is False


def test_extended_they_agree_better(found):
    (pair,) = found.agreement.to_dict("records")
    assert pair["after"] < 0.2 * pair["before"]
    assert found.log_density.shape == (40, 2)
    assert found.table["elpd"].to_dict() == pytest.approx(found.log_density.mean().to_dict())


def test_text_picture_and_report(found, tmp_path):
    text = str(found)
    assert text.startswith("The measurements favour root.")
    assert "line lacks something" in text
    assert len(text.splitlines()) <= 30
    assert found.plot().get_xlabel().startswith("held-out")
    found.report().save(tmp_path / "both.html")
    assert "Agreement" in (tmp_path / "both.html").read_text(encoding="utf-8")
    assert found.report().to_dict()["chosen"] == "root"


def test_both_are_wrong_and_the_report_says_so():
    wave = np.sin(2 * np.pi * T / 2)
    y = measured(1, 2 * np.sqrt(T) + wave)
    both = hs.compare_simulations({"one": model_of(line), "two": roots()}, X[["t"]], y)
    assert both.all_wrong
    assert both.chosen == "two"
    assert str(both).startswith("None of the 2 simulations is right; two is nearest.")


def test_evidence_is_that_in_closed_form():
    """A line with a Gaussian slope: given the noise, which is integrated over, rows are normal."""
    y, scatter = measured(2, T), halfnorm(scale=0.5)
    models = [
        model_of(line).set_params(noise_prior=scatter),
        model_of(loaded, ("t", "load")).set_params(noise_prior=scatter),
    ]
    found = hs.compare_simulations(models, X, y, diagnose=False, cv=2)
    for name, shift in (("line", 0.0), ("loaded", X["load"])):

        def density(sigma, shift=shift):
            rows = multivariate_normal(T + shift, np.outer(T, T) + sigma**2 * np.eye(len(T)))
            return rows.pdf(y) * scatter.pdf(sigma)

        exact = np.log(quad(density, 0.02, 3.0, epsabs=0, points=[0.15, 0.25, 0.8])[0])
        assert found.table.loc[name, "log_evidence"] == pytest.approx(exact, abs=0.1)
    assert found.chosen == "line"
    assert found.all_wrong is None
    assert "after" not in found.agreement
    assert not found.diagnoses


def test_known_effects_are_part_of_the_model():
    """A line with a known offset against the line alone; each in closed form."""
    y, scatter = measured(2, T + 1.5), halfnorm(scale=0.5)
    alone = model_of(line).set_params(noise_prior=scatter)
    shifted = model_of(line).set_params(noise_prior=scatter, effects=[hs.Offset()])
    quick = {"diagnose": False, "cv": 2, "random_state": 0}
    found = hs.compare_simulations({"alone": alone, "shifted": shifted}, X[["t"]], y, **quick)
    sd = found.estimators["shifted"].posterior_.model.default_sd
    for name, size in (("alone", 0.0), ("shifted", sd)):

        def density(sigma, size=size):
            covariance = np.outer(T, T) + size**2 + sigma**2 * np.eye(len(T))
            return multivariate_normal(T, covariance).pdf(y) * scatter.pdf(sigma)

        exact = np.log(quad(density, 0.02, 3.0, epsabs=0, points=[0.15, 0.25, 0.8])[0])
        assert found.table.loc[name, "log_evidence"] == pytest.approx(exact, abs=0.2)
    assert found.chosen == "shifted"


def test_runs_counts_and_several_outputs():
    y = measured(3, 2 * np.sqrt(T))
    runs = [
        hs.PowerScaledSurrogate(
            one.simulation.run(30, random_state=0),
            hs.PolynomialChaos(degree=5),
            n_draws=300,
            random_state=0,
        )
        for one in (model_of(line), roots())
    ]
    quick = {"diagnose": False, "cv": 3, "random_state": 0}
    assert hs.compare_simulations(runs, X[["t"]], y, **quick).chosen == "root"
    counts = np.random.default_rng(0).poisson(20 + 10 * np.sqrt(T))
    rates = [
        one.set_params(n_draws=300)
        for one in (
            model_of(root, likelihood="poisson", gain=norm(10, 5), level=norm(20, 5)),
            model_of(lambda t, level: level + 0 * t, likelihood="poisson", level=norm(30, 10)),
        )
    ]
    assert hs.compare_simulations(rates, X[["t"]], counts, **quick).chosen == "root"
    two = [
        model_of(lambda t, rate, f=f: {"a": f(t, rate), "b": -rate * t}, output=("a", "b"))
        for f in (line, lambda t, rate: rate * np.sqrt(t))
    ]
    Y = np.column_stack([measured(4, T), measured(5, -T)])
    Y[3, 0] = np.nan
    names = dict(zip(("linear", "bent"), two, strict=True))
    found = hs.compare_simulations(names, X[["t"]], Y, **quick)
    assert found.chosen == "linear"
    assert len(found.log_density) == 79


def test_the_same_twice_has_half_the_probability_each():
    y = measured(6, T)
    twice = hs.compare_simulations(
        [model_of(line), model_of(line)], X[["t"]], y, diagnose=False, random_state=0
    )
    assert sorted(twice.table.index) == ["line 1", "line 2"]
    np.testing.assert_allclose(twice.table["probability"], 0.5)
    assert twice.chosen is None
    assert "cannot choose" in str(twice)


def test_bad_arguments():
    y = measured(0, T)
    with pytest.raises(ValueError, match="at least two"):
        hs.compare_simulations([model_of(line)], X, y)
    with pytest.raises(TypeError, match="PowerScaledSurrogate"):
        hs.compare_simulations([model_of(line), line], X, y)
    with pytest.raises(TypeError, match="list of"):
        hs.compare_simulations(model_of(line), X, y)
    with pytest.raises(ValueError, match="outputs"):
        hs.compare_simulations([model_of(line), model_of(line, output="mass")], X, y)
    with pytest.raises(ValueError, match="likelihood"):
        hs.compare_simulations([model_of(line), model_of(line, likelihood="student-t")], X, y)
    with pytest.raises(ValueError, match="DataFrame"):
        hs.compare_simulations([model_of(line), model_of(loaded, ("t", "load"))], X.to_numpy(), y)
    with pytest.raises(ValueError, match="nothing is compared in addition"):
        hs.compare_simulations(
            [model_of(line), model_of(line).set_params(effects=[hs.Outliers()])], X, y
        )
    with pytest.raises(ValueError, match="inconsistent"):
        hs.compare_simulations([model_of(line), roots()], X, y[:-1])


def test_stacking_weights_are_those_of_two_and_at_the_optimum():
    rng = np.random.default_rng(0)
    values = rng.normal([0.0, 0.2, -3.0], size=(200, 3))
    weights = stacking_weights(values)
    assert weights.sum() == pytest.approx(1.0)
    # Karush, Kuhn, Tucker: mean density over mixture is one where the weight is positive
    mixture = np.exp(values) @ weights
    slope = np.mean(np.exp(values) / mixture[:, None], axis=0)
    assert slope[weights > 1e-3] == pytest.approx(1.0, abs=1e-3)
    assert (slope <= 1 + 1e-3).all()
    impossible = np.vstack([values, np.full(3, -np.inf)])
    np.testing.assert_allclose(stacking_weights(impossible), weights, atol=1e-6)
    clear = stacking_weights([[0.0, -np.inf], [-1.0, -2.0]])
    assert clear[0] > 0.99


@pytest.mark.slow
def test_the_right_one_has_the_probability_in_nearly_all_data_sets():
    """Of size 2: what the line cannot follow of the root is twice the noise."""
    shape = np.sqrt(T)
    left = shape - T * (T @ shape) / (T @ T)
    gain = 2 * NOISE / np.sqrt(np.mean(left**2))
    right = []
    for seed in range(100):
        y = measured(seed, gain * shape)
        models = {"line": model_of(line), "root": model_of(root, gain=norm(1, 1), level=norm(0, 1))}
        table = hs.compare_simulations(models, X[["t"]], y, diagnose=False, cv=2).table
        right.append(table.loc["root", "probability"])
    assert np.mean(np.array(right) > 0.9) >= 0.9
    assert np.mean(np.array(right) < 0.1) <= 0.05


def test_error_bars_decide_where_single_rows_are_precise():
    """Two lines through the origin differ at one precise row; the others are of no use."""
    t = np.linspace(1, 9, 20)
    errors = np.where(t == t[-1], 0.05, 5.0)
    y = 1.0 * t + errors * np.random.default_rng(0).standard_normal(20)
    models = {
        name: model_of(line, rate=hs.truncated_normal(mean, 0.01, mean - 0.05, mean + 0.05))
        for name, mean in (("right", 1.0), ("wrong", 1.2))
    }
    settings = {"diagnose": False, "random_state": 0}
    frame = pd.DataFrame({"t": t, "sd": errors})
    known = hs.compare_simulations(models, frame, y, y_err="sd", **settings)
    odds = np.ptp(known.table["log_evidence"])
    assert known.chosen == "right"
    # 1.8 at the last row in standard deviations of its error and of what the slopes are uncertain
    assert odds > 0.5 * 1.8**2 / (0.05**2 + 0.09**2) / 4
    as_array = hs.compare_simulations(models, t[:, None], y, y_err=errors, **settings)
    np.testing.assert_allclose(as_array.table["log_evidence"], known.table["log_evidence"])
    without = hs.compare_simulations(models, t[:, None], y, **settings)
    assert np.ptp(without.table["log_evidence"]) < odds / 10
