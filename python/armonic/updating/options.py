"""What a fit may be asked for, and the refusal of what it may not."""

from __future__ import annotations

from numbers import Integral
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from armonic.errors import UpdateError
from armonic.updating.genetic import Genetic
from armonic.updating.measurement import Loss, Measurement
from armonic.updating.modal_data import ModalMeasurement

if TYPE_CHECKING:
    from collections.abc import Sequence

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
    listed = (given,) if isinstance(given, Measurement | ModalMeasurement) else tuple(given)
    strange = [m for m in listed if not isinstance(m, Measurement | ModalMeasurement)]
    if strange or not listed:
        found = f"a {type(strange[0]).__name__}" if strange else "none"
        raise UpdateError("measurements", found=found, expected="at least one Measurement(frf, posture=..., frame=...)")
    return (
        tuple(m for m in listed if isinstance(m, Measurement)),
        tuple(m for m in listed if isinstance(m, ModalMeasurement)),
    )


def check_options(method: str, genetic: object, **options: Any) -> None:
    """Refuses options that no fit has.

    Raises:
        UpdateError: one of them.
    """
    words = {"method": (method, get_args(Method)), "cost": (options["cost"], get_args(Cost))}
    words["loss"] = (options["loss"], get_args(Loss))
    for name, (found, known) in words.items():
        if found not in known:
            raise UpdateError(name, found=repr(found), expected=" or ".join(f'"{word}"' for word in known))
    tolerance, limit = options["tolerance"], options["max_evaluations"]
    if not SMALLEST_TOLERANCE <= tolerance < 1:
        raise UpdateError("tolerance", found=f"{tolerance}", expected=f"a number from {SMALLEST_TOLERANCE:.1e} to 1")
    if not limit >= 1:
        raise UpdateError("max_evaluations", found=f"{limit}", expected="at least 1")
    for name in ("starts", "seed", "threads"):
        value, least = options[name], 0 if name == "seed" else 1
        if name == "threads" and value is None:
            continue
        if not isinstance(value, Integral) or isinstance(value, bool) or value < least:
            raise UpdateError(name, found=repr(value), expected=f"a whole number of at least {least}")
    if genetic is not None and not isinstance(genetic, Genetic):
        raise UpdateError("genetic", found=f"a {type(genetic).__name__}", expected="a Genetic(population=..., ...)")
    if genetic is not None and method != "genetic":
        raise UpdateError("genetic", found=f'options beside method="{method}"', expected='method="genetic"')


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
