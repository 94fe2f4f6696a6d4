"""Figures as plotly objects: responses, modes and their shapes, MAC matrices, fits, surveys and robots."""

from armonic.plots.determined import BAND_NAME, add_bands, correlation_matrix, principal_directions, profile_curve
from armonic.plots.fitting import bounded_intervals, parameter_intervals
from armonic.plots.history import cost_history
from armonic.plots.indicators import mode_indicators
from armonic.plots.look import FONT_STACK, TEMPLATE, VERDICT_COLOURS
from armonic.plots.maps import campbell, damping_map, frequency_map
from armonic.plots.matrices import frf_matrix, mac_matrix
from armonic.plots.measured import frf_with_coherence
from armonic.plots.motion import shape_animation, shape_stills
from armonic.plots.nyquist import nyquist
from armonic.plots.samples import sample_map
from armonic.plots.series import time_histories
from armonic.plots.shapes import mode_shapes
from armonic.plots.skeleton import skeleton
from armonic.plots.slices import heat_map
from armonic.plots.stabilization import stabilization_diagram

__all__ = [
    "BAND_NAME",
    "FONT_STACK",
    "TEMPLATE",
    "VERDICT_COLOURS",
    "add_bands",
    "bounded_intervals",
    "campbell",
    "correlation_matrix",
    "cost_history",
    "damping_map",
    "frequency_map",
    "frf_matrix",
    "frf_with_coherence",
    "heat_map",
    "mac_matrix",
    "mode_indicators",
    "mode_shapes",
    "nyquist",
    "parameter_intervals",
    "principal_directions",
    "profile_curve",
    "sample_map",
    "shape_animation",
    "shape_stills",
    "skeleton",
    "stabilization_diagram",
    "time_histories",
]
