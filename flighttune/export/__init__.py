"""Export of gains: a flight for JSBSim alone, the outer loop as a C file."""

from flighttune.export.c_source import c_source, export_c
from flighttune.export.jsbsim_folder import JSBSimFolder, export_jsbsim

__all__ = ["JSBSimFolder", "c_source", "export_c", "export_jsbsim"]
