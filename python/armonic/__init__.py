"""Armonic: the vibration of flexible-joint robots, from a robot file and measured FRFs to a verified dynamic model.

    import armonic as am

    robot = am.load("kuka_kr90")
    modes = am.modes(robot, "milling")
    H = am.frf(robot, "milling", freq_hz, frame="sensor")
    fit = am.update(robot, [am.Measurement(H, posture="milling", frame="sensor")])

Every public name is imported when it is first used, so that importing armonic costs next to nothing. Modules are nouns
and functions verbs, so that no module hides a function.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from armonic.assurance import frac
    from armonic.catalog import names as robots
    from armonic.checks import Finding, check
    from armonic.comparison import Comparison, ModePair, ModeTable, compare
    from armonic.comparison_at import modes_at
    from armonic.ema_report import write_ema_report
    from armonic.errors import (
        ArmonicError,
        DataFileError,
        FrfError,
        ModelError,
        PostureError,
        RobotFileError,
        SignalError,
        SimulationError,
        SurveyError,
        UpdateError,
    )
    from armonic.experiment.estimation import FrfEstimate, estimate_frf
    from armonic.experiment.hits import Hit, find_hits
    from armonic.files import read_csv, read_frf, read_uff, write_csv, write_frf, write_uff
    from armonic.files.channel_map import ChannelMap, read_channel_map
    from armonic.files.measured_file import Geometry, MeasuredFile
    from armonic.files.measured_files import read_measured, write_measured
    from armonic.files.series_files import read_series, write_series
    from armonic.frf_set import FrfSet
    from armonic.identification.clustering import select_modes
    from armonic.identification.ema import EmaResult, ema
    from armonic.identification.grid_search import grid_search
    from armonic.identification.modal_model import ModalModel
    from armonic.identification.oma import OmaResult, oma
    from armonic.identification.poles import ModelPoles
    from armonic.identification.selection import RejectedMode, SelectedMode
    from armonic.identification.stabilization import Criteria, Stabilization, stabilize
    from armonic.identification.synthesized import Synthesized, synthesized_matrix
    from armonic.identification_report import write_identification_report
    from armonic.linear import LinearModel, linearize
    from armonic.map_report import write_map_report
    from armonic.modal import Modes, mac, modes
    from armonic.report import write_report
    from armonic.response import Frf
    from armonic.robot import Robot, load
    from armonic.run_report import write_run_report
    from armonic.series import Channel, TimeSeries
    from armonic.simulation.control import SampledControl
    from armonic.simulation.excitations import (
        BandNoise,
        Excitation,
        HammerPulse,
        Impulse,
        Sine,
        Step,
        Sweep,
    )
    from armonic.simulation.joints import Backlash, Coulomb, Hardening
    from armonic.simulation.linear_response import linear_response
    from armonic.simulation.measured_force import MeasuredForce
    from armonic.simulation.running import Run, simulate
    from armonic.simulation.sensors import AntiAlias, Sensor, encoders, measure
    from armonic.simulation.tap_test import TapTest, tap_test
    from armonic.stability import GainMargin, gain_margins
    from armonic.state_space import StateSpace
    from armonic.surveying import Grid, Sample, path, survey
    from armonic.synthesis import frf, responses
    from armonic.updating import (
        Fit,
        FittedParameter,
        Genetic,
        Law,
        Measurement,
        ModalMeasurement,
        Parameter,
        Prior,
        Progress,
        Record,
        peak_weights,
        update,
    )
    from armonic.updating.bands import FrfBands, ModalIntervals, frf_bands, modal_intervals
    from armonic.updating.candidates import Candidate, candidates
    from armonic.updating.directions import Direction, correlation, directions
    from armonic.updating.expected import PlannedParameter
    from armonic.updating.planning import Plan, Ranked, plan_measurement
    from armonic.updating.profile import Profile, profile

__all__ = [
    "AntiAlias",
    "ArmonicError",
    "Backlash",
    "BandNoise",
    "Candidate",
    "Channel",
    "ChannelMap",
    "Comparison",
    "Coulomb",
    "Criteria",
    "DataFileError",
    "Direction",
    "EmaResult",
    "Excitation",
    "Finding",
    "Fit",
    "FittedParameter",
    "Frf",
    "FrfBands",
    "FrfError",
    "FrfEstimate",
    "FrfSet",
    "GainMargin",
    "Genetic",
    "Geometry",
    "Grid",
    "HammerPulse",
    "Hardening",
    "Hit",
    "Impulse",
    "Law",
    "LinearModel",
    "MeasuredFile",
    "MeasuredForce",
    "Measurement",
    "ModalIntervals",
    "ModalMeasurement",
    "ModalModel",
    "ModePair",
    "ModeTable",
    "ModelError",
    "ModelPoles",
    "Modes",
    "OmaResult",
    "Parameter",
    "Plan",
    "PlannedParameter",
    "PostureError",
    "Prior",
    "Profile",
    "Progress",
    "Ranked",
    "Record",
    "RejectedMode",
    "Robot",
    "RobotFileError",
    "Run",
    "Sample",
    "SampledControl",
    "SelectedMode",
    "Sensor",
    "SignalError",
    "SimulationError",
    "Sine",
    "Stabilization",
    "StateSpace",
    "Step",
    "SurveyError",
    "Sweep",
    "Synthesized",
    "TapTest",
    "TimeSeries",
    "UpdateError",
    "candidates",
    "check",
    "compare",
    "correlation",
    "directions",
    "ema",
    "encoders",
    "estimate_frf",
    "find_hits",
    "frac",
    "frf",
    "frf_bands",
    "gain_margins",
    "grid_search",
    "linear_response",
    "linearize",
    "load",
    "mac",
    "measure",
    "modal_intervals",
    "modes",
    "modes_at",
    "oma",
    "path",
    "peak_weights",
    "plan_measurement",
    "profile",
    "read_channel_map",
    "read_csv",
    "read_frf",
    "read_measured",
    "read_series",
    "read_uff",
    "responses",
    "robots",
    "select_modes",
    "simulate",
    "stabilize",
    "survey",
    "synthesized_matrix",
    "tap_test",
    "update",
    "write_csv",
    "write_ema_report",
    "write_frf",
    "write_identification_report",
    "write_map_report",
    "write_measured",
    "write_report",
    "write_run_report",
    "write_series",
    "write_uff",
]

__version__ = "0.1.0"

_HOME = {
    "assurance": ("frac",),
    "catalog": ("robots",),
    "checks": ("Finding", "check"),
    "errors": (
        "ArmonicError", "DataFileError", "FrfError", "ModelError", "PostureError", "RobotFileError", "SignalError",
        "SimulationError", "SurveyError", "UpdateError",
    ),
    "files": ("read_csv", "read_frf", "read_uff", "write_csv", "write_frf", "write_uff"),
    "comparison": ("Comparison", "ModePair", "ModeTable", "compare"),
    "comparison_at": ("modes_at",),
    "ema_report": ("write_ema_report",),
    "experiment.estimation": ("FrfEstimate", "estimate_frf"),
    "experiment.hits": ("Hit", "find_hits"),
    "files.channel_map": ("ChannelMap", "read_channel_map"),
    "files.measured_file": ("Geometry", "MeasuredFile"),
    "files.measured_files": ("read_measured", "write_measured"),
    "files.series_files": ("read_series", "write_series"),
    "frf_set": ("FrfSet",),
    "identification.ema": ("EmaResult", "ema"),
    "identification.modal_model": ("ModalModel",),
    "simulation.tap_test": ("TapTest", "tap_test"),
    "identification.grid_search": ("grid_search",),
    "identification.oma": ("OmaResult", "oma"),
    "identification.poles": ("ModelPoles",),
    "identification.selection": ("RejectedMode", "SelectedMode"),
    "identification.synthesized": ("Synthesized", "synthesized_matrix"),
    "identification.stabilization": ("Criteria", "Stabilization", "stabilize"),
    "identification.clustering": ("select_modes",),
    "identification_report": ("write_identification_report",),
    "run_report": ("write_run_report",),
    "series": ("Channel", "TimeSeries"),
    "simulation.control": ("SampledControl",),
    "simulation.excitations": (
        "BandNoise", "Excitation", "HammerPulse", "Impulse", "Sine", "Step", "Sweep",
    ),
    "simulation.joints": ("Backlash", "Coulomb", "Hardening"),
    "simulation.linear_response": ("linear_response",),
    "simulation.measured_force": ("MeasuredForce",),
    "simulation.running": ("Run", "simulate"),
    "simulation.sensors": ("AntiAlias", "Sensor", "encoders", "measure"),
    "linear": ("LinearModel", "linearize"),
    "map_report": ("write_map_report",),
    "modal": ("Modes", "mac", "modes"),
    "report": ("write_report",),
    "response": ("Frf",),
    "robot": ("Robot", "load"),
    "stability": ("GainMargin", "gain_margins"),
    "state_space": ("StateSpace",),
    "surveying": ("Grid", "Sample", "path", "survey"),
    "synthesis": ("frf", "responses"),
    "updating": (
        "Fit", "FittedParameter", "Genetic", "Law", "Measurement", "ModalMeasurement", "Parameter", "Prior", "Progress",
        "Record", "peak_weights", "update",
    ),
    "updating.bands": ("FrfBands", "ModalIntervals", "frf_bands", "modal_intervals"),
    "updating.candidates": ("Candidate", "candidates"),
    "updating.directions": ("Direction", "correlation", "directions"),
    "updating.expected": ("PlannedParameter",),
    "updating.planning": ("Plan", "Ranked", "plan_measurement"),
    "updating.profile": ("Profile", "profile"),
}  # fmt: skip
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names}


def __getattr__(name: str) -> object:
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'armonic' has no attribute {name!r}")
    module = import_module(f"armonic.{_MODULE_OF[name]}")
    value = getattr(module, "names" if name == "robots" else name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
