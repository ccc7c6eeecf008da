"""A diagnosis of a few seconds: what an installed package has to manage in an empty environment."""

import numpy as np

import hybridsurrogate as hs


def main() -> None:
    """Find the wave that the simulation lacks, and write the report."""
    simulator = hs.Simulator(
        lambda x, slope: slope * x,
        inputs={"x": (0, 10)},
        parameters={"slope": hs.truncated_normal(1, 0.5, 0, 3)},
    )
    x = np.linspace(0, 10, 40)
    noise = 0.1 * np.random.default_rng(0).standard_normal(40)
    model = hs.PowerScaledSurrogate(simulator, hs.ExactSurrogate(), random_state=0)
    diagnosis = hs.DiscrepancyDiagnosis(model, cv=None, random_state=0)
    diagnosis.fit(x[:, None], 1.2 * x + np.sin(2 * x) + noise)
    assert diagnosis.best_cause_.kind == "periodic"
    diagnosis.report().save("report.html")
    print(hs.__version__, hs.__file__, diagnosis.best_cause_.formula)


if __name__ == "__main__":
    main()
