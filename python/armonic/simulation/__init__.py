"""Simulation in time: excitations, runs, and what sensors make of them."""
