"""Exports of gains: a flight for JSBSim alone, or the outer loop as a C file."""
