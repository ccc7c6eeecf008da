"""What a notebook shows of a fitted estimator: data, weights, and how good the draws are."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from hybridsurrogate.model.posterior import Diagnostics, Posterior
from hybridsurrogate.notebook.tables import table
from hybridsurrogate.numerics import digits


def fitted_html(estimator: Any, draws: Sequence[tuple[str, Any, Posterior, Diagnostics]]) -> str:
    """Return what was fitted, and the quality of the draws, as HTML; nothing is computed.

    Parameters
    ----------
    estimator : estimator
        Fitted.
    draws : sequence of (name, weight, Posterior, Diagnostics)
        A weight that differs between rows is None.

    Returns
    -------
    str
    """
    rows = len(estimator.measured_[1])
    posteriors = [posterior for _, _, posterior, _ in draws]
    lines = [("Fitted to", f"{rows} rows")]
    if estimator.simulation is not None:
        lines.append(("Simulation", repr(estimator.simulation)))
    beta = getattr(estimator, "beta_", getattr(estimator, "beta", None))
    if beta is not None and not isinstance(beta, str):
        lines.append(("Weight beta", "differs between rows" if callable(beta) else f"{beta:.3g}"))
    # of several posteriors every name once
    causes = dict.fromkeys(effect.name for one in posteriors for effect in one.model.effects)
    if causes:
        lines.append(("Causes", ", ".join(causes)))
    unknowns = dict.fromkeys(name for one in posteriors for name in one.named())
    lines.append(("Unknowns", ", ".join(unknowns)))
    header = ("", "weight", "draws", "step 1", "step 2", "quality")
    quality = [_quality(*one) for one in draws]
    return (
        table(lines, caption=type(estimator).__name__)
        + table(quality, header, "Draws of the posterior")
        + "<p>Estimates: <code>.summary()</code></p>"
    )


def _quality(name: str, weight: Any, posterior: Posterior, found: Diagnostics) -> tuple[str, ...]:
    problems = found.problems()
    return (
        name,
        "differs between rows" if weight is None else digits.percent(weight),
        str(posterior.n_draws),
        _step(found.sampler, found.effective_draws, found.khat),
        _step(found.second_step, found.second_effective_draws, found.second_khat),
        f"doubtful: {'; '.join(problems)}" if problems else "good",
    )


def _step(sampler: str, effective: float, khat: float) -> str:
    words = [sampler]
    if np.isfinite(effective):
        words.append(f"{effective:.0f} effective")
    if np.isfinite(khat):
        words.append(f"k-hat {khat:.2f}")
    return ", ".join(words)
