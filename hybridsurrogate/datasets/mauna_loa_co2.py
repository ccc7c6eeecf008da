"""Carbon dioxide at Mauna Loa, and smooth growth without seasons."""

from __future__ import annotations

import numpy as np
import pandas as pd
from sklearn.utils import Bunch

from hybridsurrogate.datasets.measured import measured_bunch
from hybridsurrogate.datasets.tables import packaged_table
from hybridsurrogate.priors import truncated_normal
from hybridsurrogate.simulation.simulator import Simulator
from hybridsurrogate.types import FloatArray


def co2_growth(
    year: FloatArray, preindustrial: FloatArray, excess_1958: FloatArray, growth_rate: FloatArray
) -> FloatArray:
    """Return the concentration in ppm if emissions grow exponentially and a fixed share stays."""
    return preindustrial + excess_1958 * np.exp(growth_rate * (year - 1958))


def load_mauna_loa_co2() -> Bunch:
    """Load the carbon dioxide at Mauna Loa, month by month from March 1958 to December 2001.

    The simulation is what one would write first: emissions grow exponentially and a fixed share of
    them stays in the air, so the concentration is ``preindustrial + excess_1958 * exp(growth_rate *
    (year - 1958))``. It has no seasons.

    Returns
    -------
    sklearn.utils.Bunch
        data : DataFrame of shape (521, 1)
            The column ``year``, with its decimals.
        target : Series of shape (521,)
            Mole fraction of carbon dioxide in dry air, in parts per million (ppm).
        frame : DataFrame
            Both.
        simulator : Simulator
            Parameters: ``preindustrial`` and ``excess_1958`` in ppm, ``growth_rate`` per year.
        DESCR : str
            A description.

    Notes
    -----
    Public domain. The priors contain the 280 ppm that ice cores show for the time before 1800 [2]_
    and the 315 ppm of 1958. They let emissions grow by one to three per cent a year.

    References
    ----------
    .. [1] C. D. Keeling, T. P. Whorf, "Atmospheric CO2 concentrations derived from flask air
       samples at sites in the SIO network", in Trends, Carbon Dioxide Information Analysis Center,
       Oak Ridge National Laboratory, 2004; weekly values in statsmodels.datasets.co2.
    .. [2] D. M. Etheridge et al., "Natural and anthropogenic changes in atmospheric CO2 over the
       last 1000 years from air in Antarctic ice and firn", Journal of Geophysical Research 101,
       1996.

    Examples
    --------
    >>> from hybridsurrogate.datasets import load_mauna_loa_co2
    >>> co2 = load_mauna_loa_co2()
    >>> co2.data.shape
    (521, 1)
    >>> co2.simulator
    Simulator(co2_growth: year -> co2, parameters: preindustrial, excess_1958, growth_rate)
    """
    table = packaged_table("mauna_loa_co2.csv")
    frame = pd.DataFrame({"year": table["decimal_year"], "co2": table["co2_ppm"]})
    simulator = Simulator(
        co2_growth,
        inputs={"year": (1958, 2002)},
        parameters={
            "preindustrial": truncated_normal(280, 10, 250, 310),
            "excess_1958": truncated_normal(35, 10, 10, 70),
            "growth_rate": truncated_normal(0.02, 0.01, 0.001, 0.05),
        },
        output="co2",
    )
    return measured_bunch(
        frame,
        simulator,
        "Carbon dioxide at Mauna Loa, Hawaii, monthly means, 1958 to 2001, against a "
        "simulation of smooth growth that has no seasons.\n"
        "Source: Keeling and Whorf, Scripps Institution of Oceanography and CDIAC, through "
        "statsmodels.datasets.co2.\n"
        "Licence: public domain.\n"
        "Units: years; parts per million of dry air.",
    )
