"""What a fit may be asked for, and the refusal of what it may not."""

from __future__ import annotations

from collections.abc import Mapping
from numbers import Integral, Real
from os import PathLike
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from armonic.errors import RobotFileError, UpdateError
from armonic.robot import Robot
from armonic.updating.genetic import Genetic
from armonic.updating.measurement import Loss, Measurement
from armonic.updating.modal_data import ModalMeasurement
from armonic.updating.parameters import PATTERNS, listed

if TYPE_CHECKING:
    from collections.abc import Sequence

    from armonic.updating.parameters import Patterns
    from armonic.updating.task import Task

Method = Literal["continuation", "least_squares", "genetic"]
Cost = Literal["logarithmic", "relative"]

SMALLEST_TOLERANCE = float(np.finfo(float).eps)


def sorted_measurements(
    given: Measurement | ModalMeasurement | Sequence[Measurement | ModalMeasurement],
) -> tuple[tuple[Measurement, ...], tuple[ModalMeasurement, ...]]:
    """Responses and modes apart.

    Raises:
        UpdateError: none at all, or something else among them.
    """
    expected = "at least one Measurement(frf, posture=..., frame=...)"
    several = [given] if isinstance(given, Measurement | ModalMeasurement) else listed(given, "measurements", expected)
    strange = [m for m in several if not isinstance(m, Measurement | ModalMeasurement)]
    if strange or not several:
        found = f"a {type(strange[0]).__name__}" if strange else "none"
        raise UpdateError("measurements", found=found, expected=expected)
    return (
        tuple(m for m in several if isinstance(m, Measurement)),
        tuple(m for m in several if isinstance(m, ModalMeasurement)),
    )


def with_held(robot: Robot, hold: Patterns | Mapping[str, float]) -> tuple[Robot, Patterns]:
    """The robot with the values of what is held, and the patterns of that.

    Raises:
        UpdateError: no paths, or a value that the robot cannot have.
    """
    if isinstance(hold, str):
        return robot, hold
    if not isinstance(hold, Mapping):
        return robot, listed(hold, "hold", PATTERNS)
    for path, value in hold.items():
        try:
            robot = robot.with_values({path: value})
        except (UpdateError, RobotFileError) as error:
            raise UpdateError(f"hold {path}", found=error.found, expected=error.expected, hint=error.hint) from None
    return robot, list(hold)


def check_options(method: str, genetic: object, *, modes_alone: bool, **options: Any) -> None:
    """Refuses options that no fit has.

    Raises:
        UpdateError: one of them.
    """
    words = {"method": (method, get_args(Method)), "cost": (options["cost"], get_args(Cost))}
    words["loss"] = (options["loss"], get_args(Loss))
    for name, (found, known) in words.items():
        if found not in known:
            raise UpdateError(name, found=repr(found), expected=" or ".join(f'"{word}"' for word in known))
    for name, ordinary in {"cost": "logarithmic", "loss": "squares"}.items():
        if modes_alone and options[name] != ordinary:
            raise UpdateError(name, found=f'"{options[name]}" for modes alone', expected=f'"{ordinary}"')
    tolerance = options["tolerance"]
    if not isinstance(tolerance, Real) or not SMALLEST_TOLERANCE <= float(tolerance) < 1:
        raise UpdateError("tolerance", found=f"{tolerance}", expected=f"a number from {SMALLEST_TOLERANCE:.1e} to 1")
    for name in ("max_evaluations", "starts", "seed", "threads"):
        value, least = options[name], 0 if name == "seed" else 1
        if name == "threads" and value is None:
            continue
        if not isinstance(value, Integral) or isinstance(value, bool) or value < least:
            raise UpdateError(name, found=repr(value), expected=f"a whole number of at least {least}")
    if genetic is not None and not isinstance(genetic, Genetic):
        raise UpdateError("genetic", found=f"a {type(genetic).__name__}", expected="a Genetic(population=..., ...)")
    if genetic is not None and method != "genetic":
        raise UpdateError("genetic", found=f'options beside method="{method}"', expected='method="genetic"')


def check_kinds(robot: object, checkpoint: object, progress: object, **mappings: object) -> None:
    """Refuses arguments that are something else altogether.

    Raises:
        UpdateError: one of them.
    """
    if not isinstance(robot, Robot):
        raise UpdateError("robot", found=f"a {type(robot).__name__}", expected="a Robot, as from armonic.load(...)")
    for name, given in mappings.items():
        if given is not None and not isinstance(given, Mapping):
            raise UpdateError(name, found=repr(given), expected="a mapping by path or pattern, or none")
    if checkpoint is not None and not isinstance(checkpoint, str | PathLike):
        raise UpdateError("checkpoint", found=repr(checkpoint), expected="the path of a file, or none")
    if progress is not None and not callable(progress):
        raise UpdateError("progress", found=repr(progress), expected="a function of one Progress, or none")


def refuse_few(task: Task, weights: Sequence[Any]) -> None:
    """Refuses fewer numbers than parameters.

    Raises:
        UpdateError: there are.
    """
    count = 2 * int(sum(np.count_nonzero(w) for w in weights)) + len(task.anchors.indices)
    for m in task.modal:
        per_mode = 1 + (m.damping_ratio is not None) + (0 if m.shapes is None else 2 * np.shape(m.shapes)[1] - 2)
        count += len(m) * per_mode
    if count < len(task.parameters):
        raise UpdateError(
            "measurements",
            found=f"{count} numbers for {len(task.parameters)} parameters",
            expected="at least as many numbers as parameters",
            hint="Fit fewer parameters, hold or tie some, give priors, or use more lines.",
        )
