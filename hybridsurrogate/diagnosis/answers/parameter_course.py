"""The parameters that would have to vary, over the input along which they wander."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from hybridsurrogate.effects.parameters.parameter_process import ParameterProcess

# the tails of a 90 % band
_TAILS = (0.05, 0.95)


def parameter_course(before: Any, extended: Any, n: int = 101) -> pd.DataFrame:
    """Return each parameter that wanders over its input, a row a place.

    Parameters
    ----------
    before, extended : PowerScaledSurrogate
        Fitted, without and with the causes.
    n : int, default=101
        Places over the measured range.

    Returns
    -------
    pandas.DataFrame
        As `DiscrepancyDiagnosis.parameter_course`; without rows where none wanders.
    """
    posterior = extended.posterior_
    named, constant = posterior.named(), before.posterior_.named()
    tables = []
    for k, cause in enumerate(posterior.model.effects):
        if not isinstance(cause, ParameterProcess):
            continue
        assert cause.ends is not None  # it is prepared
        x, name = np.linspace(*cause.ends, n), cause.parameter
        drawn = cause.course(x, named[name], posterior.draws_of(k)[0])
        lower, upper = np.quantile(drawn, _TAILS, axis=0)
        course = {"mean": drawn.mean(axis=0), "lower": lower, "upper": upper}
        own = {"parameter": name, "over": cause.over, "x": x, **course}
        tables.append(pd.DataFrame(own).assign(constant=float(np.mean(constant[name]))))
    return pd.concat(tables, ignore_index=True) if tables else pd.DataFrame()
