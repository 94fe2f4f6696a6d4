"""Modes of a model as sensors see them: their shapes over degrees of freedom of frames."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from armonic.comparison import ModeTable
from armonic.errors import ModelError
from armonic.frf_set import split_label
from armonic.synthesis import AXES

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from armonic.linear import LinearModel
    from armonic.modal import Modes

    Complex: TypeAlias = NDArray[np.complex128]


def modes_at(model: LinearModel, modes: Modes, labels: Iterable[str]) -> ModeTable:
    """The shapes J u of a model's modes at degrees of freedom such as "sensor.x", for `armonic.compare`.

    J is the Jacobian of the frame in its own axes (Huynh et al. 2021, Eq. 28, takes a finite pose difference for it),
    u the shape over the joint coordinates.

    Args:
        model: the linear model at the posture of the measurement.
        modes: its modes, as `armonic.modes` gives them for that model.
        labels: degrees of freedom FRAME.AXIS, axes x y z rx ry rz; each once.

    Returns:
        Poles of all modes and their shapes, (m, labels), in m and rad.

    Raises:
        ModelError: the modes are over other coordinates than the model.
        PostureError: the robot has no such frame.
        FrfError: a label is not FRAME.AXIS.
        SignalError: a label comes twice.
    """
    if modes.coordinates != model.coordinates:
        found = f"modes over {', '.join(modes.coordinates)}"
        raise ModelError("modes", found=found, expected=f"modes of the model, over {', '.join(model.coordinates)}")
    names = tuple(labels)
    frames: dict[str, Complex] = {}
    shapes = np.zeros((len(modes), len(names)), np.complex128)
    for column, label in enumerate(names):
        frame, axis = split_label(label)
        if axis not in AXES:
            raise ModelError("labels", found=repr(label), expected=f"an axis among {', '.join(AXES)}")
        if frame not in frames:
            frames[frame] = model.jacobian(frame) @ modes.shapes
        shapes[:, column] = frames[frame][AXES.index(axis)]
    return ModeTable(modes.poles, shapes, names)
