"""Export of gains: a flight for JSBSim alone, the outer loop as a C file."""
