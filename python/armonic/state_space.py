"""A linear model as ẋ = A x + B u, y = C x + D u, for NumPy, MATLAB and python-control."""

from __future__ import annotations

from dataclasses import dataclass
from io import BytesIO
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from armonic.errors import FrfError, ModelError
from armonic.synthesis import AXES
from armonic.writing import write_whole

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from armonic.linear import LinearModel

    Array: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class StateSpace:
    """ẋ = A x + B u, y = C x + D u, in SI and radians, with a name for every row and column.

    Attributes:
        A: (S, S).
        B: (S, inputs).
        C: (outputs, S).
        D: (outputs, inputs), zero: forces move masses.
        states: deviations of the coordinates ("arm.z", "arm.motor"), their rates ("arm.z rate"), and the torque of
            every integrator of the control ("arm.motor integral", N m).
        inputs: force or moment at the frame ("tip.x", N or N m), then motor torques behind the gear ("arm.motor", N m).
        outputs: displacement of the frame ("tip.x", m or rad), then motor positions behind the gear ("arm.motor", rad).
        origin: robot and posture.
    """

    A: Array
    B: Array
    C: Array
    D: Array
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    origin: str

    def __repr__(self) -> str:
        """Its size and where it comes from, in one line."""
        size = f"{len(self.states)} states, {len(self.inputs)} inputs, {len(self.outputs)} outputs"
        return f"StateSpace({size}, {self.origin})"

    def save_mat(self, path: str | Path) -> None:
        """Write a MATLAB file with A, B, C, D and cell arrays of names, whole or not at all.

        In MATLAB: `m = load('model.mat'); sys = ss(m.A, m.B, m.C, m.D, 'StateName', m.states, 'InputName', m.inputs,
        'OutputName', m.outputs)`.

        Args:
            path: of the file to write.

        Raises:
            DataFileError: the file cannot be written.
        """
        from scipy.io import savemat

        matrices = {name: getattr(self, name) for name in "ABCD"}
        names = {name: _cells(getattr(self, name)) for name in ("states", "inputs", "outputs")}
        file = BytesIO()
        savemat(file, {**matrices, **names, "origin": self.origin})  # type: ignore[arg-type]  # stubs know no files
        write_whole(path, file.getvalue())

    def to_control(self) -> Any:
        """The same as `control.StateSpace` of python-control, whose names have "_" in place of ".".

        Raises:
            ModelError: python-control is not installed.
        """
        try:
            import control
        except ImportError:
            raise ModelError(
                "to_control", found="no python-control", expected="it installed", hint="Run `pip install control`."
            ) from None
        names = {name: [n.replace(".", "_") for n in getattr(self, name)] for name in ("states", "inputs", "outputs")}
        return control.ss(self.A, self.B, self.C, self.D, **names)


def state_space(
    model: LinearModel, *, frame: str, inputs: tuple[str, ...], outputs: tuple[str, ...], motors: bool
) -> StateSpace:
    """What `LinearModel.state_space` gives."""
    for name, axes in (("inputs", inputs), ("outputs", outputs)):
        unknown = [axis for axis in axes if axis not in AXES]
        if unknown:
            raise FrfError(name, found=", ".join(map(repr, unknown)), expected=f"axes among {' '.join(AXES)}")
    J, n = model.jacobian(frame), len(model.coordinates)
    own = np.eye(n)[model.loop.motors] if motors else np.zeros((0, n))
    forced, watched = (np.vstack([J[[AXES.index(axis) for axis in axes]], own]) for axes in (inputs, outputs))
    A, factor = model.state_matrix(), model.mass_factor
    B = np.zeros((len(A), len(forced)))
    B[n : 2 * n] = np.linalg.solve(factor.T, np.linalg.solve(factor, forced.T))
    names = model.drives.names
    turned = names if motors else ()
    return StateSpace(
        A=A,
        B=B,
        C=np.pad(watched, ((0, 0), (0, len(A) - n))),
        D=np.zeros((len(watched), len(forced))),
        states=(
            *model.coordinates,
            *(f"{name} rate" for name in model.coordinates),
            *(f"{names[i]} integral" for i in model.loop.integrating),
        ),
        inputs=(*(f"{frame}.{axis}" for axis in inputs), *turned),
        outputs=(*(f"{frame}.{axis}" for axis in outputs), *turned),
        origin=f"{model.robot.name}, posture {model.posture}",
    )


def _cells(names: tuple[str, ...]) -> NDArray[np.object_]:
    """Names as a column of MATLAB cells."""
    cells = np.empty((len(names), 1), object)
    cells[:, 0] = names
    return cells
