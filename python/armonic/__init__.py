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
    from armonic.errors import (
        ArmonicError,
        DataFileError,
        FrfError,
        ModelError,
        PostureError,
        RobotFileError,
        SurveyError,
        UpdateError,
    )
    from armonic.files import read_csv, read_frf, read_uff, write_csv, write_frf, write_uff
    from armonic.linear import LinearModel, linearize
    from armonic.map_report import write_map_report
    from armonic.modal import Modes, mac, modes
    from armonic.report import write_report
    from armonic.response import Frf
    from armonic.robot import Robot, load
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
    "ArmonicError",
    "Candidate",
    "DataFileError",
    "Direction",
    "Finding",
    "Fit",
    "FittedParameter",
    "Frf",
    "FrfBands",
    "FrfError",
    "GainMargin",
    "Genetic",
    "Grid",
    "Law",
    "LinearModel",
    "Measurement",
    "ModalIntervals",
    "ModalMeasurement",
    "ModelError",
    "Modes",
    "Parameter",
    "Plan",
    "PlannedParameter",
    "PostureError",
    "Prior",
    "Profile",
    "Progress",
    "Ranked",
    "Record",
    "Robot",
    "RobotFileError",
    "Sample",
    "StateSpace",
    "SurveyError",
    "UpdateError",
    "candidates",
    "check",
    "correlation",
    "directions",
    "frac",
    "frf",
    "frf_bands",
    "gain_margins",
    "linearize",
    "load",
    "mac",
    "modal_intervals",
    "modes",
    "path",
    "peak_weights",
    "plan_measurement",
    "profile",
    "read_csv",
    "read_frf",
    "read_uff",
    "responses",
    "robots",
    "survey",
    "update",
    "write_csv",
    "write_frf",
    "write_map_report",
    "write_report",
    "write_uff",
]

__version__ = "0.1.0"

_HOME = {
    "assurance": ("frac",),
    "catalog": ("robots",),
    "checks": ("Finding", "check"),
    "errors": (
        "ArmonicError", "DataFileError", "FrfError", "ModelError", "PostureError", "RobotFileError", "SurveyError",
        "UpdateError",
    ),
    "files": ("read_csv", "read_frf", "read_uff", "write_csv", "write_frf", "write_uff"),
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
