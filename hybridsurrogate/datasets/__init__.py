"""Measured data with a simulation that is not quite right."""

from hybridsurrogate.datasets.log_sin import make_log_sin
from hybridsurrogate.datasets.mauna_loa_co2 import load_mauna_loa_co2
from hybridsurrogate.datasets.nile import load_nile
from hybridsurrogate.datasets.sir import make_sir

__all__ = ["load_mauna_loa_co2", "load_nile", "make_log_sin", "make_sir"]
