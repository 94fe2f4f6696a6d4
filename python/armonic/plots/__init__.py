"""Figures as plotly objects: FRF matrices, MAC matrices, cost history and parameter intervals."""

from armonic.plots.fitting import cost_history, parameter_intervals
from armonic.plots.look import FONT_STACK, TEMPLATE, VERDICT_COLOURS
from armonic.plots.matrices import frf_matrix, mac_matrix

__all__ = [
    "FONT_STACK",
    "TEMPLATE",
    "VERDICT_COLOURS",
    "cost_history",
    "frf_matrix",
    "mac_matrix",
    "parameter_intervals",
]
