"""Measured data as they are handed out, next to the simulation of them."""

from __future__ import annotations

import pandas as pd
from sklearn.utils import Bunch

from hybridsurrogate.simulation.simulator import Simulator


def measured_bunch(frame: pd.DataFrame, simulator: Simulator, description: str) -> Bunch:
    """Return a table of which the simulation's inputs are the data, its output the target.

    Parameters
    ----------
    frame : DataFrame
        With columns of the names of the simulation's inputs and of its output.
    simulator : Simulator
    description : str

    Returns
    -------
    sklearn.utils.Bunch
        data, target, frame, simulator, DESCR
    """
    return Bunch(
        data=frame[list(simulator.input_names)],
        target=frame[simulator.output],
        frame=frame,
        simulator=simulator,
        DESCR=description,
    )
