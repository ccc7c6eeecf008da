"""Measured data with a simulation that is not quite right."""

from hybridsurrogate.datasets.covid19_italy import fetch_covid19_italy
from hybridsurrogate.datasets.log_sin import make_log_sin
from hybridsurrogate.datasets.measured import (
    load_mauna_loa_co2,
    load_nile,
    load_nist_chwirut1,
    load_nist_enso,
)
from hybridsurrogate.datasets.sir import make_sir

__all__ = [
    "fetch_covid19_italy",
    "load_mauna_loa_co2",
    "load_nile",
    "load_nist_chwirut1",
    "load_nist_enso",
    "make_log_sin",
    "make_sir",
]
