"""Draws the picture of the README: `python docs/figures/readme.py`.

The flow of the Nile at Aswan, 1871 to 1970 (public domain), against a simulation of constant flow:
above what the simulation and the extended model predict, below what each leaves.
"""

from pathlib import Path

import numpy as np

import hybridsurrogate as hs
from hybridsurrogate.datasets import load_nile
from hybridsurrogate.plotting import (
    AFTER,
    BEFORE,
    DATA,
    Prediction,
    new_axes,
    plot_prediction,
    plot_residuals,
    tidy,
)


def prediction(model, X):
    """Return mean and intervals at rows."""
    ends = [end for level in (0.5, 0.9) for end in model.predict_interval(X, level=level)]
    return Prediction(model.predict(X), *ends)


def main():
    """Diagnose, and draw."""
    data = load_nile()
    y = np.asarray(data.target)
    model = hs.PowerScaledSurrogate(data.simulator, hs.ExactSurrogate(), random_state=0)
    diagnosis = hs.DiscrepancyDiagnosis(model, cv=None, random_state=0).fit(data.data, y)
    best, year = diagnosis.best_cause_, np.asarray(data.data["year"], dtype=float)
    above, below = new_axes(2, 1, 7.5, 4.6, share=True)
    above.plot(year, y, ".", color=DATA, ms=4, label="measured")
    pairs = (
        (diagnosis.estimator_, BEFORE, "simulation"),
        (diagnosis.extended_estimator_, AFTER, f"extended by a {best.kind}"),
    )
    for fitted, colour, name in pairs:
        predicted = prediction(fitted, data.data)
        plot_prediction(above, year, predicted, colour, name)
        plot_residuals(below, year, y - predicted.mean, colour, "")
    tidy(above, "", "flow in 10⁸ m³ a year")
    tidy(below, "year", "measured − predicted", legend=False)
    above.set_ylim(400, 1650)  # room for the legend
    below.set_title("")
    chance = f"{100 * diagnosis.probability_right_:.0f} %"
    above.set_title(
        f"{diagnosis.verdict_}: a {best.kind}, probability of being right {chance}",
        fontsize="medium",
        loc="left",
    )
    above.figure.savefig(Path(__file__).with_suffix(".png"), dpi=110)


if __name__ == "__main__":
    main()
