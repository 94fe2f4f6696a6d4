"""Model updating: joint elasticity that makes the model agree with measured frequency responses.

measurement.py what was measured and how its lines are weighted; parameters.py what may change, within which bounds;
solver.py the least-squares run; uncertainty.py what the data determine; fit.py the whole task and its result.
"""

from armonic.updating.fit import Fit, update
from armonic.updating.measurement import Measurement, peak_weights
from armonic.updating.uncertainty import FittedParameter

__all__ = ["Fit", "FittedParameter", "Measurement", "peak_weights", "update"]
