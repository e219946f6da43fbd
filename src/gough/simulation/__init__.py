"""Simulation: motions of a mechanism under its actuators, one run or ensembles of runs."""
