"""The pressure between Easter Island and Darwin, and seasons alone."""

from __future__ import annotations

import numpy as np
import pandas as pd
from scipy.stats import norm
from sklearn.utils import Bunch

from hybridsurrogate.datasets.measured import measured_bunch
from hybridsurrogate.datasets.tables import packaged_table
from hybridsurrogate.simulation.simulator import Simulator
from hybridsurrogate.types import FloatArray


def seasonal_pressure(
    month: FloatArray, mean: FloatArray, cosine: FloatArray, sine: FloatArray
) -> FloatArray:
    """Return a pressure difference that repeats every twelve months."""
    angle = 2 * np.pi * month / 12
    return mean + cosine * np.cos(angle) + sine * np.sin(angle)


def load_nist_enso() -> Bunch:
    """Load the pressure difference between Easter Island and Darwin over 168 months.

    The simulation has the seasons alone. The difference also swings with El Niño and the Southern
    Oscillation; NIST certifies periods of 44.3 and 26.9 months [1]_.

    Returns
    -------
    sklearn.utils.Bunch
        data : DataFrame of shape (168, 1)
            The column ``month``, counted from 1.
        target : Series of shape (168,)
            Monthly mean difference of the pressures, in hPa by its size: the source names no unit.
        frame : DataFrame
            Both.
        simulator : Simulator
            Parameters: ``mean``, ``cosine`` and ``sine`` in hPa.
        DESCR : str
            A description.

    Notes
    -----
    Public domain. The priors are about 10 hPa between the stations and seasons of a few hPa.

    References
    ----------
    .. [1] D. Kahaner, C. Moler, S. Nash, "Numerical Methods and Software", Prentice Hall, 1989,
       pages 441 to 445: data set ENSO of the Statistical Reference Datasets, National Institute of
       Standards and Technology.

    Examples
    --------
    >>> from hybridsurrogate.datasets import load_nist_enso
    >>> enso = load_nist_enso()
    >>> enso.data.shape
    (168, 1)
    >>> enso.simulator
    Simulator(seasonal_pressure: month -> pressure_difference, parameters: mean, cosine, sine)
    """
    table = packaged_table("nist_enso.csv")
    frame = pd.DataFrame({"month": table["month"], "pressure_difference": table["pressure_diff"]})
    simulator = Simulator(
        seasonal_pressure,
        inputs={"month": (1, 168)},
        parameters={"mean": norm(10, 5), "cosine": norm(0, 3), "sine": norm(0, 3)},
        output="pressure_difference",
    )
    return measured_bunch(
        frame,
        simulator,
        "Monthly pressure difference between Easter Island and Darwin, against a simulation "
        "of seasons without El Niño and the Southern Oscillation.\n"
        "Source: NIST Statistical Reference Datasets, ENSO (Kahaner, Moler and Nash 1989).\n"
        "Licence: public domain (work of the United States government).\n"
        "Units: months; hPa by its size, as the source names no unit.",
    )
