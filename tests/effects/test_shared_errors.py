"""Errors that rows share: batches and known covariances, in closed form and over data sets."""

import numpy as np
import pandas as pd
import pytest
from few_kinds import all_but
from scipy.linalg import block_diag
from scipy.stats import lognorm, multivariate_normal, norm

import hybridsurrogate as hs

N = 30
T = np.linspace(0, 10, N)
PRIORS = {"level": norm(0, 2), "slope": norm(0, 1)}
COVARIANCE = 0.3**2 * np.exp(-np.abs(T[:, None] - T) / 2) + 0.1**2 * np.eye(N)
ROWS = pd.DataFrame({"t": T, "row": np.arange(N)})
DESIGN = np.column_stack([np.ones(N), T])
PRIOR = np.diag([4.0, 1.0])


def line(t, level, slope):
    return level + slope * t


def model_of(**settings):
    simulator = hs.Simulator(line, {"t": (0, 10)}, PRIORS, output="y")
    settings = {"surrogate": hs.ExactSurrogate(), "random_state": 0, **settings}
    return hs.PowerScaledSurrogate(simulator, **settings)


def measured(seed, covariance=COVARIANCE):
    errors = np.random.default_rng(seed).multivariate_normal(np.zeros(N), covariance)
    return line(T, 1.0, 0.5) + errors


def of_rows():
    y_err, shared = hs.SharedErrors.of_rows(COVARIANCE, "row")
    return y_err, model_of(effects=[shared], noise="known", n_draws=4000)


def test_the_fit_is_that_of_generalised_least_squares():
    y, (y_err, model) = measured(0), of_rows()
    table = model.fit(ROWS, y, y_err=y_err).summary()
    precision = DESIGN.T @ np.linalg.solve(COVARIANCE, DESIGN) + np.linalg.inv(PRIOR)
    exact = np.linalg.solve(precision, DESIGN.T @ np.linalg.solve(COVARIANCE, y))
    sd = np.sqrt(np.diag(np.linalg.inv(precision)))
    # 4000 draws, of which some count for less: four standard errors
    there = table.loc[["level", "slope"], "mean"].to_numpy(dtype=float)
    np.testing.assert_array_less(np.abs(there - exact), 4 * sd / np.sqrt(1000))
    np.testing.assert_allclose(table.loc[["level", "slope"], "sd"].astype(float), sd, rtol=0.07)


def test_held_out_rows_are_predicted_given_those_that_share_their_errors():
    y, (y_err, model) = measured(1), of_rows()
    # the covariance is of all rows, those that are held out too
    test = np.arange(N) % 5 == 2
    model.fit(ROWS[~test], y[~test], y_err=y_err[~test])
    whole = DESIGN @ PRIOR @ DESIGN.T + COVARIANCE
    known, cross = whole[np.ix_(~test, ~test)], whole[np.ix_(test, ~test)]
    mean = cross @ np.linalg.solve(known, y[~test])
    sd = np.sqrt(np.diag(whole[np.ix_(test, test)] - cross @ np.linalg.solve(known, cross.T)))
    there, spread = model.predict(ROWS[test], return_std=True, y_err=y_err[test])
    np.testing.assert_allclose(spread, sd, rtol=0.05)
    np.testing.assert_array_less(np.abs(there - mean), 0.1 * sd)
    density = model.log_predictive_density(ROWS[test], y[test], y_err=y_err[test])
    np.testing.assert_allclose(density, norm.logpdf(y[test], mean, sd), atol=0.1)


def test_the_evidence_is_that_of_the_covariance():
    y, (y_err, model) = measured(2), of_rows()
    flat = hs.Simulator(lambda t, level: level + 0 * t, {"t": (0, 10)}, {"level": norm(0, 2)})
    models = {"line": model, "flat": model_of().set_params(**model.get_params(deep=False))}
    models["flat"].set_params(simulation=flat)
    found = hs.compare_simulations(models, ROWS, y, y_err=y_err, diagnose=False, cv=2)
    for name, design in (("line", DESIGN), ("flat", DESIGN[:, :1])):
        prior = PRIOR[: design.shape[1], : design.shape[1]]
        exact = multivariate_normal(cov=design @ prior @ design.T + COVARIANCE).logpdf(y)
        assert found.table.loc[name, "log_evidence"] == pytest.approx(exact, abs=0.05)


def batches(seed, spread=0.4):
    """Eight batches of five rows, each in a different part of the axis."""
    random = np.random.default_rng(seed)
    level, slope = random.normal(0, 2), random.normal()
    t = np.clip(np.repeat(random.uniform(0, 10, 8), 5) + random.uniform(-1, 1, 40), 0, 10)
    errors = np.repeat(spread * random.standard_normal(8), 5)
    y = line(t, level, slope) + errors + 0.1 * random.standard_normal(40)
    X = pd.DataFrame({"t": t, "run": np.repeat([f"r{k}" for k in range(8)], 5)})
    return X, y, {"level": level, "slope": slope, "spread": spread}


TOLD = {"experiment": "run", "by_experiment": {"y": "spread"}}


def test_a_batch_that_was_not_measured_is_as_uncertain_as_batches_differ():
    X, y, _ = batches(0)
    model = model_of(**TOLD).fit(X, y)
    new = pd.DataFrame({"t": [5.0, 5.0], "run": ["r3", "another"]})
    near, far = model.predict(new, return_std=True)[1]
    spread = float(model.summary().loc["spread", "mean"])
    assert near < far
    assert far == pytest.approx(np.hypot(spread, near), rel=0.25)
    # a known spread is that of a diagonal covariance
    names = [f"r{k}" for k in range(8)]
    known = pd.DataFrame(0.16 * np.eye(8), index=names)
    both = [
        model_of(experiment="run", effects=[one]).fit(X, y).summary().loc["slope", ["mean", "sd"]]
        for one in (hs.SharedErrors("run", spread=0.4), hs.SharedErrors("run", covariance=known))
    ]
    np.testing.assert_allclose(*(one.to_numpy(dtype=float) for one in both), rtol=0.02)


@pytest.mark.slow
def test_intervals_cover_over_data_sets_with_a_batch_error():
    """Truths are drawn from their priors; without the batches the same intervals cover half."""
    inside, without = [], []
    for seed in range(200):
        X, y, truth = batches(seed)
        for out, told in ((inside, TOLD), (without, {"experiment": "run"})):
            table = model_of(**told).fit(X, y).summary()
            names = [name for name in truth if name in table.index]
            out.append([table.q5[name] < truth[name] < table.q95[name] for name in names])
    # binomial, 200 sets of 90 %: 0.02 is one standard error
    assert np.all(np.abs(np.mean(inside, axis=0) - 0.9) < 0.055)
    assert np.all(np.mean(without, axis=0) < 0.7)


def diagnosed(X, y, **told):
    settings = {"cv": None, "n_replicates": 100, "random_state": 0}
    few = all_but("step", "trend", "periodic", "missing-input", "noise", "curve-by-experiment")
    return hs.DiscrepancyDiagnosis(model_of(**told), exclude=few, **settings).fit(X, y)


@pytest.mark.slow
def test_a_diagnosis_knows_the_batches():
    random = np.random.default_rng(3)
    X, _, _ = batches(3)
    X["t"] = random.uniform(0, 10, 40)
    y = line(X["t"], 1.0, 0.5) + np.repeat(0.4 * random.standard_normal(8), 5)
    y = (y + 0.1 * random.standard_normal(40)).to_numpy()
    assert diagnosed(X, y, experiment="run").best_cause_.target == "run"
    found = diagnosed(X, y, **TOLD)
    assert found.verdict_ == "adequate"
    stepped = diagnosed(X, y + 1.0 * (X["t"] > 5).to_numpy(), **TOLD)
    assert stepped.best_cause_.kind == "step"
    assert stepped.best_cause_.estimates["amplitude"][0] == pytest.approx(1.0, abs=0.2)
    assert "shared error: spread" in str(stepped.report(full=True))
    assert "not in the simulation: shared-errors(run)" in stepped.to_python()
    gain = stepped.cross_validate(cv=3).gain_
    assert gain.elpd_difference > 2 * gain.standard_error


# ------------------------------------------------------------------------------ several outputs


def two_lines(t, level, slope):
    return {"height": level + slope * t, "flow": 10 * (level - slope * t)}


OUTPUTS = ("height", "flow")
DESIGNS = {"height": DESIGN, "flow": 10 * np.column_stack([np.ones(N), -T])}
COVARIANCES = {
    "height": COVARIANCE,
    "flow": 2.0**2 * np.exp(-np.abs(T[:, None] - T) / 4) + 0.5**2 * np.eye(N),
}


def model_of_two(**settings):
    simulator = hs.Simulator(two_lines, {"t": (0, 10)}, PRIORS, output=OUTPUTS)
    settings = {"surrogate": hs.ExactSurrogate(), "random_state": 0, **settings}
    return hs.PowerScaledSurrogate(simulator, **settings)


def both_measured(seed):
    random = np.random.default_rng(seed)
    return np.column_stack(
        [
            DESIGNS[name] @ [1.0, 0.5] + random.multivariate_normal(np.zeros(N), COVARIANCES[name])
            for name in OUTPUTS
        ]
    )


def stacked_normal():
    """Prior predictive of both outputs, one after the other: their errors are independent."""
    design = np.vstack([DESIGNS[name] for name in OUTPUTS])
    return design, design @ PRIOR @ design.T + block_diag(*(COVARIANCES[k] for k in OUTPUTS))


def test_each_output_has_a_covariance_of_its_own():
    """The evidence, the fit, and held-out rows are those of the block covariance."""
    y = both_measured(0)
    y_err, shared = hs.SharedErrors.of_rows(COVARIANCES, "row")
    model = model_of_two(effects=[shared], noise="known", n_draws=1000)
    design, whole = stacked_normal()
    stacked = y.T.ravel()
    # a level alone, for a difference of evidence that rests on the covariance
    flat = hs.Simulator(
        lambda t, level: {"height": level + 0 * t, "flow": 10 * level + 0 * t},
        {"t": (0, 10)},
        {"level": norm(0, 2)},
        output=OUTPUTS,
    )
    models = {
        "line": model,
        "flat": model_of_two(**{k: model.get_params(False)[k] for k in ("effects", "noise")}),
    }
    models["flat"].set_params(simulation=flat, n_draws=1000)
    found = hs.compare_simulations(models, ROWS, y, y_err=y_err, diagnose=False, cv=2)
    constant = np.concatenate([np.ones(N), np.full(N, 10.0)])
    of_flat = 4 * np.outer(constant, constant) + whole - design @ PRIOR @ design.T
    exact = [multivariate_normal(cov=cov).logpdf(stacked) for cov in (whole, of_flat)]
    evidence = found.table.loc[["line", "flat"], "log_evidence"].to_numpy(dtype=float)
    assert evidence[0] - evidence[1] == pytest.approx(exact[0] - exact[1], abs=1e-6)
    # outputs are measured in units of their standard deviations
    units = N * np.sum(np.log(np.std(y, axis=0)))
    np.testing.assert_allclose(evidence - units, exact, atol=1e-6)

    test = np.arange(N) % 5 == 2
    model.fit(ROWS[~test], y[~test], y_err=y_err[~test])
    out = np.tile(test, 2)
    known, cross = whole[np.ix_(~out, ~out)], whole[np.ix_(out, ~out)]
    mean = cross @ np.linalg.solve(known, stacked[~out])
    sd = np.sqrt(np.diag(whole[np.ix_(out, out)] - cross @ np.linalg.solve(known, cross.T)))
    there, spread = model.predict(ROWS[test], return_std=True, y_err=y_err[test])
    np.testing.assert_allclose(spread.T.ravel(), sd, rtol=0.06)
    np.testing.assert_array_less(np.abs(there.T.ravel() - mean), 0.15 * sd)


def batches_of_two(seed, spreads=(0.4, 3.0)):
    X, _, truth = batches(seed)
    random = np.random.default_rng([seed, 1])
    means = two_lines(X["t"].to_numpy(), truth["level"], truth["slope"])
    errors = np.repeat(random.standard_normal((8, 2)) * spreads, 5, axis=0)
    noise = random.standard_normal((40, 2)) * (0.1, 1.0)
    y = np.column_stack([means[name] for name in OUTPUTS]) + errors + noise
    return X, y, {"level": truth["level"], "slope": truth["slope"]}, errors


def test_batches_of_several_outputs_have_a_spread_each():
    X, y, _, errors = batches_of_two(0)
    by = {"height": "spread", "flow": "spread"}
    table = model_of_two(experiment="run", by_experiment=by).fit(X, y).summary()
    for name, size in zip(OUTPUTS, np.sqrt(np.mean(errors**2, axis=0)), strict=True):
        there = table.loc[f"{name}: spread"]
        assert there["q5"] < size < there["q95"]
        assert there["q95"] < 4 * size
    assert "flow: run = r3" in table.index
    # one output alone; the other has none
    for settings in (
        {"by_experiment": {"flow": "spread"}},
        {"effects": [hs.SharedErrors("run", spread={"flow": None})]},
    ):
        table = model_of_two(experiment="run", **settings).fit(X, y).summary()
        assert "flow: spread" in table.index
        assert not any("height: " in name for name in table.index)


def test_a_known_spread_of_an_output_is_that_of_a_diagonal_covariance():
    X, y, *_ = batches_of_two(0)
    names = [f"r{k}" for k in range(8)]
    spreads = {"height": 0.4, "flow": 3.0}
    known = {name: pd.DataFrame(sd**2 * np.eye(8), index=names) for name, sd in spreads.items()}
    both = [
        model_of_two(experiment="run", effects=[one]).fit(X, y).summary().loc["slope"]
        for one in (hs.SharedErrors("run", spreads), hs.SharedErrors("run", covariance=known))
    ]
    np.testing.assert_allclose(*(one[["mean", "sd"]].astype(float) for one in both), rtol=0.02)


@pytest.mark.slow
def test_intervals_cover_over_data_sets_with_batch_errors_in_two_outputs():
    """Truths are drawn from their priors; without the batches the same intervals cover half."""
    spread = {"height": lognorm(0.3, scale=0.4), "flow": lognorm(0.3, scale=3.0)}
    shared = hs.SharedErrors("run", spread=spread)
    inside, without = [], []
    for seed in range(100):
        random = np.random.default_rng([seed, 2])
        spreads = [prior.rvs(random_state=random) for prior in spread.values()]
        X, y, truth, _ = batches_of_two(seed, spreads)
        truth |= {f"{name}: spread": sd for name, sd in zip(spread, spreads, strict=True)}
        for out, how in ((inside, {"effects": [shared]}), (without, {})):
            table = model_of_two(experiment="run", **how).fit(X, y).summary()
            names = [name for name in truth if name in table.index]
            out.append([table.q5[name] < truth[name] < table.q95[name] for name in names])
    # binomial, 100 sets of 90 %: 0.03 is one standard error
    assert np.all(np.abs(np.mean(inside, axis=0) - 0.9) < 0.08)
    assert np.all(np.mean(without, axis=0) < 0.75)


@pytest.mark.parametrize(
    ("effect", "message"),
    [
        (hs.SharedErrors("run", spread=0.4), "units of their own, height, flow; give"),
        (hs.SharedErrors("run", covariance=np.eye(8)), "units of their own"),
        (hs.SharedErrors("run", spread={"flw": 0.4}), "no output 'flw'.*'flow'"),
        (hs.SharedErrors("run", spread={"flow": -0.4}), "spread that is positive"),
        (
            hs.SharedErrors("run", spread={"flow": 1.0}, covariance={"flow": np.eye(8)}),
            "not both",
        ),
        (hs.InOutput(hs.SharedErrors("run"), "flow"), "without InOutput"),
        (
            hs.SharedErrors(
                "run",
                covariance={
                    "flow": pd.DataFrame(np.eye(8), index=[f"r{k}" for k in range(8)]),
                    "height": pd.DataFrame(np.eye(8)[:7, :7], index=[f"r{k}" for k in range(7)]),
                },
            ),
            "has no 'r7'",
        ),
    ],
)
def test_what_cannot_be_shared_by_several_outputs_is_refused(effect, message):
    X, y, *_ = batches_of_two(0)
    with pytest.raises(ValueError, match=message):
        model_of_two(experiment="run", effects=[effect]).fit(X, y)


@pytest.mark.slow
def test_a_diagnosis_of_two_outputs_knows_the_batches():
    X, y, *_ = batches_of_two(3)
    random = np.random.default_rng(3)
    X["t"] = random.uniform(0, 10, 40)
    means = two_lines(X["t"].to_numpy(), 1.0, 0.5)
    errors = np.repeat(random.standard_normal((8, 2)) * (0.4, 3.0), 5, axis=0)
    y = np.column_stack([means[name] for name in OUTPUTS]) + errors
    y = y + random.standard_normal((40, 2)) * (0.1, 1.0)
    few = all_but("step", "trend", "missing-input", "noise", "curve-by-experiment")
    by = {"height": "spread", "flow": "spread"}
    verdicts = {}
    for told, size in ((False, 0.0), (True, 0.0), (True, 1.0)):
        model = model_of_two(experiment="run", by_experiment=by if told else None)
        diagnosis = hs.DiscrepancyDiagnosis(
            model, exclude=few, cv=None, n_replicates=100, random_state=0
        )
        step = np.outer(X["t"] > 5, [size, 0.0])
        verdicts[told, size] = diagnosis.fit(X, y + step)
    assert verdicts[False, 0.0].verdict_ != "adequate"
    assert verdicts[True, 0.0].verdict_ == "adequate"
    assert verdicts[True, 1.0].best_cause_.kind == "step"
    assert "height: spread" in str(verdicts[True, 1.0].report(full=True))


# ----------------------------------------------------------------------------------- bad input


def changed(k, j, value):
    matrix = COVARIANCE.copy()
    matrix[k, j] = value
    return matrix


@pytest.mark.parametrize(
    ("covariance", "message"),
    [
        (COVARIANCE[:, :-1], "square matrix, got shape .30, 29."),
        (COVARIANCE[0], "square matrix, got shape .30,."),
        (changed(2, 5, 0.5), "not symmetric: 0.5 in row 3, column 6"),
        (changed(2, 5, np.nan), "1 values that are NaN or infinite, the first in row 3, column 6"),
        (changed(4, 4, -1.0), "not positive definite: its smallest eigenvalue"),
        (np.ones((N, N)), "each row needs an error of its own"),
        ([["a"]], "a matrix of numbers"),
    ],
)
def test_what_is_no_covariance_is_refused(covariance, message):
    with pytest.raises(ValueError, match=message):
        hs.SharedErrors.of_rows(covariance, "row")


@pytest.mark.parametrize(
    ("effect", "settings", "message"),
    [
        (hs.SharedErrors("row", covariance=COVARIANCE[:9, :9]), {}, "none for row = 9 "),
        (hs.SharedErrors("row", spread=1.0, covariance=COVARIANCE), {}, "not both"),
        (hs.SharedErrors("row", spread=-1.0), {}, "spread that is positive"),
        (hs.SharedErrors("t"), {}, "one of its inputs"),
        (hs.SharedErrors("run"), {}, "no measured column 'run'"),
        (
            hs.SharedErrors("row", covariance=COVARIANCE),
            {"likelihood": "student-t"},
            "leave out the covariance",
        ),
        (
            hs.SharedErrors("row", covariance=COVARIANCE),
            {"likelihood": hs.Censored(below=0.0)},
            "normal on its scale",
        ),
    ],
)
def test_what_cannot_be_shared_is_refused(effect, settings, message):
    with pytest.raises(ValueError, match=message):
        model_of(effects=[effect], **settings).fit(ROWS, measured(0))


def test_names_in_a_covariance_are_those_of_the_experiments():
    X, y, _ = batches(0)
    wrong = pd.DataFrame(np.eye(8), index=[f"s{k}" for k in range(8)])
    model = model_of(experiment="run", effects=[hs.SharedErrors("run", covariance=wrong)])
    with pytest.raises(ValueError, match="has no 'r0'"):
        model.fit(X, y)


def test_a_matrix_of_errors_says_where_it_goes():
    with pytest.raises(ValueError, match="SharedErrors"):
        model_of().fit(ROWS, measured(0), y_err=COVARIANCE)


@pytest.mark.parametrize(
    ("by", "message"), [({"y": "own"}, 'must be "spread"'), ({"z": "spread"}, "not a parameter")]
)
def test_an_output_differs_between_experiments_by_its_errors_alone(by, message):
    X, y, _ = batches(0)
    with pytest.raises(ValueError, match=message):
        model_of(experiment="run", by_experiment=by).fit(X, y)
