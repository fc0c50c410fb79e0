"""Export of gains: a flight for JSBSim alone, the outer loop as a C file."""

from flighttune.export.c_source import c_source, export_c
from flighttune.export.jsbsim_folder import CSV, SCRIPT, export_jsbsim

__all__ = ["CSV", "SCRIPT", "c_source", "export_c", "export_jsbsim"]
