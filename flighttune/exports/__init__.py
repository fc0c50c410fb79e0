"""Export of gains: a flight for JSBSim alone, the outer loop as a C file."""

from flighttune.exports.c_source import c_source, export_c
from flighttune.exports.check import COLUMNS
from flighttune.exports.jsbsim_folder import CSV, README, SCRIPT, export_jsbsim

__all__ = ["COLUMNS", "CSV", "README", "SCRIPT", "c_source", "export_c", "export_jsbsim"]
