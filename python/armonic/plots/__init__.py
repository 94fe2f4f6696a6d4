"""Figures as plotly objects: FRF matrices, MAC matrices, cost history and parameter intervals."""

from armonic.plots.fitting import cost_history, parameter_intervals
from armonic.plots.look import TEMPLATE
from armonic.plots.matrices import frf_matrix, mac_matrix

__all__ = ["TEMPLATE", "cost_history", "frf_matrix", "mac_matrix", "parameter_intervals"]
