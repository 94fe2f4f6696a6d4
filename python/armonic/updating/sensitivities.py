"""How responses, poles and shapes move with the coordinates of a fit, whichever numbers of the description those are.

The slopes of a model's matrices come from `tangent`; from there on everything is exact in s.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from armonic import _core
from armonic.errors import FrfError, ModelError
from armonic.linear import linearize
from armonic.modal import Modes, modes
from armonic.synthesis import AXES, system
from armonic.updating.tangent import Tangent, neighbours, tangent, values_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import ArrayLike, NDArray

    from armonic.linear import Posture
    from armonic.robot import Robot
    from armonic.updating.parameters import Parameter

    Array: TypeAlias = NDArray[np.float64]
    Complex: TypeAlias = NDArray[np.complex128]
    Points: TypeAlias = NDArray[np.complexfloating[Any, Any]]


def frf_sensitivities(
    robot: Robot,
    posture: Posture,
    freq_hz: ArrayLike,
    parameters: Sequence[Parameter],
    *,
    frame: str,
    outputs: Iterable[str] = ("x", "y", "z"),
    inputs: Iterable[str] = ("x", "y", "z"),
    input_frame: str | None = None,
) -> tuple[Complex, Complex]:
    """Receptances of a robot and the slopes of their logarithms in the coordinates of a fit.

    Args:
        robot: the robot, at whose own numbers the slopes are taken.
        posture: a posture's name or joint coordinates.
        freq_hz: lines, (L,), Hz.
        parameters: the c coordinates.
        frame: where the response is taken.
        outputs: response axes among x y z rx ry rz of the frame.
        inputs: force and moment axes.
        input_frame: where the force acts, if elsewhere.

    Returns:
        H, (L, p, m), and ∂ln H/∂x, (L, p, m, c), complex; zero where H itself is zero and has no logarithm.

    Raises:
        PostureError: posture or frame do not fit the robot.
        FrfError: unknown axes, or lines that are not numbers.
        ModelError: the model has no response on a line, or cannot be built.
    """
    try:
        points = 2j * np.pi * np.asarray(freq_hz, float)
    except (TypeError, ValueError) as error:
        raise FrfError("freq_hz", found=f"{type(freq_hz).__name__} ({error})", expected="numbers in Hz") from None
    at = _tangent(robot, posture, parameters)
    H, slopes = receptances(at, points, frame, tuple(outputs), tuple(inputs), input_frame)
    return H, np.divide(slopes, H[..., None], out=np.zeros_like(slopes), where=H[..., None] != 0)


def pole_sensitivities(robot: Robot, posture: Posture, parameters: Sequence[Parameter]) -> tuple[Modes, Complex]:
    """Modes of a robot and the slopes of their poles in the coordinates of a fit.

    Args:
        robot: the robot, at whose own numbers the slopes are taken.
        posture: a posture's name or joint coordinates.
        parameters: the c coordinates.

    Returns:
        The modes as `armonic.modes` has them, and ∂λ/∂x, (modes, c), rad/s, in their order; zero for poles at zero.

    Raises:
        PostureError: the posture does not fit the robot.
        ModelError: the model cannot be built.
    """
    return mode_sensitivities(robot, posture, parameters)[:2]


def mode_sensitivities(
    robot: Robot, posture: Posture, parameters: Sequence[Parameter]
) -> tuple[Modes, Complex, Complex]:
    """Modes of a robot and the slopes of their poles and shapes in the coordinates of a fit.

    Args:
        robot: the robot, at whose own numbers the slopes are taken.
        posture: a posture's name or joint coordinates.
        parameters: the c coordinates.

    Returns:
        The modes; ∂λ/∂x, (modes, c); and ∂u/∂x, (N, modes, c), of shapes u whose scale is held by uᴴ M ∂u = 0.

    Raises:
        PostureError: the posture does not fit the robot.
        ModelError: the model cannot be built.
    """
    at = _tangent(robot, posture, parameters)
    found = modes(at.model)
    return found, *pole_slopes(at, found)


def _tangent(robot: Robot, posture: Posture, parameters: Sequence[Parameter]) -> Tangent:
    values = values_of(robot, parameters)
    sides = neighbours(robot, parameters, values)
    return tangent(linearize(robot, posture), posture, parameters, values, sides)


def receptances(
    at: Tangent,
    points: Points,
    frame: str,
    outputs: tuple[str, ...],
    inputs: tuple[str, ...],
    input_frame: str | None,
    *,
    slopes: bool = True,
) -> tuple[Complex, Complex]:
    """H = J_out Z⁻¹ J_inᵀ at points s, (L, p, m), and ∂H/∂x, (L, p, m, c), which is empty unless asked for.

    ∂H = ∂J_out X + Yᵀ ∂J_inᵀ − Yᵀ ∂Z X with X = Z⁻¹ J_inᵀ and Yᵀ = J_out Z⁻¹.

    Raises:
        PostureError: unknown frame.
        FrfError: unknown axis.
        ModelError: the dynamic stiffness is singular at a point.
    """
    model, s = at.model, np.asarray(points, np.complex128)
    by_core = not at.general and not model.loop.integrating.size
    try:
        if by_core:
            core = system(model, frame, outputs, inputs, input_frame=input_frame)
            H, by_value = _core.responses(
                [core], model.spring[None], model.damper[None], s, sensitivities=slopes and bool(at.sides)
            )
            if by_value is None:
                return H[0], np.zeros((*H.shape[1:], len(at.sides) if slopes else 0), complex)
            return H[0], by_value[0] @ np.hstack([at.spring, at.damper]).T
        return _by_lapack(at, s, (frame, outputs), (input_frame or frame, inputs), slopes=slopes)
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        raise ModelError(
            f"frequency response at {frame}", found=str(error), expected="damping in every mode, or lines beside it"
        ) from None


def _by_lapack(
    at: Tangent,
    points: Points,
    output: tuple[str, tuple[str, ...]],
    source: tuple[str, tuple[str, ...]],
    *,
    slopes: bool,
) -> tuple[Complex, Complex]:
    """As `receptances`, for whatever enters the matrices; frames with their axes.

    Raises:
        LinAlgError: the dynamic stiffness is singular at a point.
    """
    model = at.model
    s = points[:, None, None]
    # No force acts on a motor, so that its row may be multiplied by s: G/s then stays finite at 0 Hz.
    integrating = model.links + model.loop.integrating

    def dynamic(G: Array, K: Array, C: Array, M: Array) -> Complex:
        Z = s**2 * M + s * C + K
        Z[:, integrating] = s * Z[:, integrating] + G[integrating]
        return np.asarray(Z)

    watched, hit = (model.jacobian(frame)[_rows(axes)] for frame, axes in (output, source))
    Z = dynamic(model.integral, model.stiffness, model.damping, model.mass)
    X = np.linalg.solve(Z, np.broadcast_to(hit.T, (len(Z), *hit.T.shape)))
    H = np.asarray(watched @ X)
    if not slopes:
        return H, np.zeros((*H.shape, 0), complex)
    Y = np.linalg.solve(Z.swapaxes(1, 2), np.broadcast_to(watched.T, (len(Z), *watched.T.shape))).swapaxes(1, 2)
    B = model.directions.T
    at_outputs, at_inputs = (Y @ B)[:, :, None, :], (B.T @ X).swapaxes(1, 2)[:, None]
    by_spring = -at_outputs * at_inputs
    D = by_spring @ at.spring.T + s[..., None] * (by_spring @ at.damper.T)
    out, into = (at.jacobian(frame)[:, _rows(axes)] for frame, axes in (output, source))
    for i in at.general:
        D[..., i] = out[i] @ X + Y @ into[i].T - Y @ dynamic(*at.matrices[i]) @ X
    return H, np.asarray(D)


def _rows(axes: tuple[str, ...]) -> list[int]:
    """Rows of a Jacobian.

    Raises:
        FrfError: unknown axis.
    """
    unknown = [axis for axis in axes if axis not in AXES]
    if unknown or not axes:
        found = ", ".join(map(repr, unknown)) or "none"
        raise FrfError("axes", found=found, expected=f"axes among {' '.join(AXES)}")
    return [AXES.index(axis) for axis in axes]


def pole_slopes(at: Tangent, found: Modes) -> tuple[Complex, Complex]:
    """Slopes of poles, (modes, c), and of shapes, (N, modes, c), of a model's modes.

    The bordered system [Z(λ), Z′(λ) u; uᴴ M, 0] [∂u; ∂λ] = [−∂Z u; 0] holds for real poles as well, and where Z is not
    symmetric. It is singular where poles coincide; then the least of its solutions is taken, which gives the slope
    of the mean where there is one. Poles at zero are those of rigid bodies and stay there.
    """
    model, moving = at.model, np.flatnonzero(found.poles != 0)
    poles, u = found.poles[moving], found.shapes[:, moving].T
    N, c, m = len(model.coordinates), len(at.sides), len(found)
    G, K, C, M = model.integral, model.stiffness, model.damping, model.mass
    x = poles[:, None, None]
    bordered = np.zeros((len(moving), N + 1, N + 1), complex)
    bordered[:, :N, :N] = x**2 * M + x * C + K + G / x
    bordered[:, :N, N] = (u[:, None] @ (2 * x * M + C - G / x**2).swapaxes(1, 2))[:, 0]
    bordered[:, N, :N] = u.conj() @ M
    powers = poles[:, None] ** np.arange(-1, 3)
    right = np.zeros((len(moving), N + 1, c), complex)
    right[:, :N] = -np.einsum("mk,ckab,mb->mac", powers, at.matrices, u, optimize=True)
    # Rows and columns of one size each, so that springs of MN/m and rates of kilorad/s do not spoil the solution.
    rows = 1 / np.abs(bordered).max(axis=2)
    columns = 1 / np.abs(bordered * rows[..., None]).max(axis=1)
    balanced = rows[..., None] * bordered * columns[:, None]
    try:
        solved = np.linalg.solve(balanced, rows[..., None] * right)
    except np.linalg.LinAlgError:
        solved = np.linalg.pinv(balanced, rcond=1e-12) @ (rows[..., None] * right)
    solved *= columns[..., None]
    dpoles, dshapes = np.zeros((m, c), complex), np.zeros((N, m, c), complex)
    dpoles[moving], dshapes[:, moving] = solved[:, N], solved[:, :N].swapaxes(0, 1)
    dpoles[moving] = np.where(found.oscillatory[moving, None], dpoles[moving], dpoles[moving].real)
    return dpoles, dshapes
