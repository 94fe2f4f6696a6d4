"""Model updating: numbers of a description that make the model agree with measurements, and how far to trust them.

Data walks from measurement.py, modal_data.py, parameters.py, laws.py and priors.py (what was measured, what may change,
what is known) into task.py, whose residuals (residuals.py; dense.py and modal_data.py where the core has none) the
stages of a run (smoothing.py, stages.py) minimize; running.py and search.py run them from one start or many,
procedure.py and genetic.py are the paper's method, judging.py and uncertainty.py say what the data determine, fit.py is
the whole, result.py what comes out. On its result stand directions.py, bands.py, profile.py and planning.py.
"""

from armonic.updating.fit import update
from armonic.updating.genetic import Genetic
from armonic.updating.laws import Law
from armonic.updating.measurement import Measurement, peak_weights
from armonic.updating.modal_data import ModalMeasurement
from armonic.updating.parameters import Parameter
from armonic.updating.priors import Prior
from armonic.updating.record import Record
from armonic.updating.result import Fit
from armonic.updating.running import Progress
from armonic.updating.uncertainty import FittedParameter

__all__ = [
    "Fit",
    "FittedParameter",
    "Genetic",
    "Law",
    "Measurement",
    "ModalMeasurement",
    "Parameter",
    "Prior",
    "Progress",
    "Record",
    "peak_weights",
    "update",
]
