"""The ultrasonic response of NIST, and a pulse that is only absorbed."""

from __future__ import annotations

import numpy as np
import pandas as pd
from sklearn.utils import Bunch

from hybridsurrogate.datasets.measured import measured_bunch
from hybridsurrogate.datasets.tables import packaged_table
from hybridsurrogate.priors import truncated_normal
from hybridsurrogate.simulation.simulator import Simulator
from hybridsurrogate.types import FloatArray


def absorbed_pulse(
    distance: FloatArray, amplitude: FloatArray, absorption: FloatArray
) -> FloatArray:
    """Return the response to a pulse that loses the same share over every bit of its way."""
    return amplitude * np.exp(-absorption * distance)


def load_nist_chwirut1() -> Bunch:
    """Load the ultrasonic response of a reference block over the distance to metal.

    The simulation is pure absorption, ``amplitude * exp(-absorption * distance)``. The formula that
    NIST certifies also divides by a line in the distance [1]_.

    Returns
    -------
    sklearn.utils.Bunch
        data : DataFrame of shape (214, 1)
            The column ``distance``, in the unit of the source, which names none.
        target : Series of shape (214,)
            Response, likewise.
        frame : DataFrame
            Both.
        simulator : Simulator
            Parameters: ``amplitude``, ``absorption``.
        DESCR : str
            A description.

    Notes
    -----
    Public domain. The prior of the amplitude is as wide as the range of an instrument whose full
    scale is of order 100.

    References
    ----------
    .. [1] D. Chwirut, "Ultrasonic reference block study", 1979: data set Chwirut1 of the
       Statistical Reference Datasets, National Institute of Standards and Technology.

    Examples
    --------
    >>> from hybridsurrogate.datasets import load_nist_chwirut1
    >>> block = load_nist_chwirut1()
    >>> block.data.shape
    (214, 1)
    >>> block.simulator
    Simulator(absorbed_pulse: distance -> response, parameters: amplitude, absorption)
    """
    table = packaged_table("nist_chwirut1.csv")
    frame = pd.DataFrame({"distance": table["distance"], "response": table["response"]})
    simulator = Simulator(
        absorbed_pulse,
        inputs={"distance": (0.4, 6.5)},
        parameters={
            "amplitude": truncated_normal(100, 50, 10, 300),
            "absorption": truncated_normal(0.5, 0.4, 0.01, 3),
        },
        output="response",
    )
    return measured_bunch(
        frame,
        simulator,
        "Ultrasonic response of a reference block over the distance to metal, against a "
        "simulation of pure absorption.\n"
        "Source: NIST Statistical Reference Datasets, Chwirut1.\n"
        "Licence: public domain (work of the United States government).\n"
        "Units: not named by the source.",
    )
