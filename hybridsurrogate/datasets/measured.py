"""Measured data inside the package, each with a simulation that lacks something."""

from __future__ import annotations

from importlib import resources

import numpy as np
import pandas as pd
from scipy.stats import norm
from sklearn.utils import Bunch

from hybridsurrogate.priors import truncated_normal
from hybridsurrogate.simulation.simulator import Simulator
from hybridsurrogate.types import FloatArray


def packaged_table(file: str) -> pd.DataFrame:
    """Return a csv file of the package's folder ``data``, whose head names source and licence.

    Parameters
    ----------
    file : str

    Examples
    --------
    >>> from hybridsurrogate.datasets.measured import packaged_table
    >>> packaged_table("nile_flow.csv").shape
    (100, 2)
    """
    path = resources.files("hybridsurrogate.datasets") / "data" / file
    with path.open(encoding="utf-8") as opened:
        return pd.read_csv(opened, comment="#")


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
