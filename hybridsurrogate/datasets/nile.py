"""The flow of the Nile at Aswan, and a river that never changes."""

from __future__ import annotations

import pandas as pd
from scipy.stats import norm
from sklearn.utils import Bunch

from hybridsurrogate.datasets.measured import measured_bunch
from hybridsurrogate.datasets.tables import packaged_table
from hybridsurrogate.simulation.simulator import Simulator
from hybridsurrogate.types import FloatArray


def nile_flow(year: FloatArray, mean_flow: FloatArray) -> FloatArray:
    """Return the same flow every year."""
    return mean_flow + 0 * year


def load_nile() -> Bunch:
    """Load the yearly flow of the Nile at Aswan from 1871 to 1970.

    The simulation predicts a constant flow. In fact it fell in about 1898 [1]_.

    Returns
    -------
    sklearn.utils.Bunch
        data : DataFrame of shape (100, 1)
            The column ``year``.
        target : Series of shape (100,)
            Flow in 1e8 cubic metres a year.
        frame : DataFrame
            Both.
        simulator : Simulator
            Parameter: ``mean_flow`` in 1e8 cubic metres a year.
        DESCR : str
            A description.

    Notes
    -----
    Public domain; from statsmodels.datasets.nile.

    References
    ----------
    .. [1] G. W. Cobb, "The problem of the Nile: conditional solution to a changepoint problem",
       Biometrika 65, 1978.

    Examples
    --------
    >>> from hybridsurrogate.datasets import load_nile
    >>> nile = load_nile()
    >>> nile.data.shape
    (100, 1)
    >>> nile.simulator
    Simulator(nile_flow: year -> flow, parameters: mean_flow)
    """
    table = packaged_table("nile_flow.csv")
    frame = pd.DataFrame({"year": table["year"].astype(float), "flow": table["flow_1e8m3"]})
    simulator = Simulator(
        nile_flow,
        inputs={"year": (1871, 1970)},
        parameters={"mean_flow": norm(1000, 200)},
        output="flow",
    )
    return measured_bunch(
        frame,
        simulator,
        "Flow of the Nile at Aswan, 1871 to 1970, against a simulation in which it never "
        "changes.\n"
        "Source: Cobb 1978, through statsmodels.datasets.nile.\n"
        "Licence: public domain.\n"
        "Units: years; 1e8 cubic metres a year.",
    )
