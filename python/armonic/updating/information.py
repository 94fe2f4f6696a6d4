"""What measurements tell about the coordinates of a fit: the information of each, from its sensitivities."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from armonic.errors import ArmonicError, UpdateError
from armonic.linear import linearize
from armonic.updating.laws import values_in
from armonic.updating.sensitivities import receptances
from armonic.updating.tangent import given, neighbours, tangent

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from armonic.linear import Posture
    from armonic.robot import Robot
    from armonic.updating.candidates import Candidate
    from armonic.updating.measurement import Measurement
    from armonic.updating.parameters import Parameter
    from armonic.updating.tangent import Tangent

    Array: TypeAlias = NDArray[np.float64]
    Complex: TypeAlias = NDArray[np.complex128]

ABSENT = 1e-11
"""A response below this share of the largest of its matrix, on all lines, is zero but for rounding, as across the plane
of a planar robot. It has no logarithm, and nothing to tell."""


class Outlook:
    """A robot as its sensors would see it, and how that depends on the coordinates of a fit.

    Args:
        robot: the robot.
        parameters: the c coordinates.
        values: their values, (c,); the robot gets them.

    Raises:
        UpdateError: a number of the parameters is not one of the robot.
        RobotFileError: there is no such robot.
    """

    def __init__(self, robot: Robot, parameters: Sequence[Parameter], values: Array) -> None:
        self.parameters, self.values = tuple(parameters), np.asarray(values, float)
        self.robot = robot.with_values(given(self.parameters, self.values))
        # The slope of a law is no number of its own: it acts through the one that it belongs to.
        self._own = [i for i, p in enumerate(self.parameters) if p.paths]
        self._numbers = [self.parameters[i] for i in self._own]
        self._sides = neighbours(self.robot, self._numbers, self.values[self._own])

    def at(self, posture: Posture) -> tuple[Tangent, Array]:
        """The linear model in a posture with its slopes by the numbers there, and theirs by the coordinates, (., c).

        Raises:
            PostureError: the posture does not fit the robot.
            ModelError: the model cannot be built.
            ArithmeticError: a law has no positive stiffness there.
        """
        model = linearize(self.robot, posture)
        here, chain = values_in(self.parameters, self.values, model)
        if any(p.law is not None for p in self.parameters):
            theta = np.concatenate([model.spring, model.damper])
            for i in self._own:
                theta[list(self.parameters[i].indices)] = here[i]
            model = model.with_impedances(*theta.reshape(2, -1))
        return tangent(model, posture, self._numbers, here[self._own], self._sides), chain[self._own]

    @staticmethod
    def seen(
        place: tuple[Tangent, Array],
        freq_hz: Array,
        frame: str,
        outputs: tuple[str, ...],
        inputs: tuple[str, ...],
        input_frame: str | None,
    ) -> tuple[Complex, Complex, NDArray[np.bool_]]:
        """Receptances H, (L, p, m), and ∂ln H/∂x, (L, p, m, c), at a place from `at`.

        The last array says which values of H are more than rounding, (L, p, m); elsewhere the slopes are zero.

        Raises:
            PostureError: unknown frame.
            FrfError: unknown axis.
            ModelError: the model has no response on a line.
        """
        at, chain = place
        H, slopes = receptances(at, 2j * np.pi * freq_hz, frame, outputs, inputs, input_frame)
        size = np.abs(H)
        present = np.asarray((size > ABSENT * size.max(axis=(1, 2), keepdims=True)).any(axis=0) & (size > 0))
        D = np.divide(slopes, H[..., None], out=np.zeros_like(slopes), where=present[..., None])
        return H, np.asarray(D @ chain, complex), present


def information(D: Complex) -> Array:
    """Re DᴴD, (c, c), of log responses (..., c) whose real and imaginary parts are independent and of unit noise."""
    rows = D.reshape(-1, D.shape[-1])
    parts = np.concatenate([rows.real, rows.imag])
    return np.asarray(parts.T @ parts)


def of_measurements(outlook: Outlook, measurements: Sequence[Measurement]) -> tuple[Array, float, list[Complex]]:
    """What has been measured, under equal weights for all lines that are used, or as their coherence has it.

    Args:
        outlook: the robot that was fitted to it.
        measurements: one or more.

    Returns:
        Its information for noise of one, (c, c); the noise that the residual speaks of (standard deviation of one real
        part of ln H); the model's responses, each in the kind and lines of its measurement, (L, p, m).

    Raises:
        PostureError: a posture or frame does not fit the robot.
        ModelError: the model has no response on a line, or cannot be built.
        ArithmeticError: a law has no positive stiffness.
    """
    c = len(outlook.parameters)
    total, square, count = np.zeros((c, c)), 0.0, 0
    models: list[Complex] = []
    for m in measurements:
        used = m.line_weights() > 0
        precision = m.precision()
        place = outlook.at(m.posture)
        H, D, present = outlook.seen(place, m.frf.freq_hz, m.frame, m.frf.outputs, m.frf.inputs, m.frf.input_frame)
        power = {"receptance": 0, "mobility": 1, "accelerance": 2}[m.frf.kind]
        model = H * ((2j * np.pi * m.frf.freq_hz) ** power)[:, None, None]
        models.append(model)
        total += information(np.sqrt(precision[used])[:, None] * D[used])
        used &= present
        ratio = m.frf.values[used] / model[used]
        square += float(np.sum(precision[used] * (np.log(np.abs(ratio)) ** 2 + np.angle(ratio) ** 2)))
        count += 2 * ratio.size
    return total, float(np.sqrt(square / max(count - c, 1))), models


def of_candidates(outlook: Outlook, candidates: Sequence[Candidate], freq_hz: Array) -> Array:
    """Information of each candidate for noise of one, (N, c, c); what candidates share is computed once.

    Args:
        outlook: the robot.
        candidates: N of them.
        freq_hz: lines of those that have none of their own, (L,), Hz.

    Raises:
        UpdateError: the robot does not have one, or it has no response; it is named.
    """
    places: dict[bytes, dict[tuple[Any, ...], list[int]]] = {}
    for i, option in enumerate(candidates):
        with _naming(option):
            where = outlook.robot.posture(option.posture).tobytes()
        lines = freq_hz if option.freq_hz is None else np.asarray(option.freq_hz)
        sight = (option.frame, option.input_frame or option.frame, lines.tobytes())
        places.setdefault(where, {}).setdefault(sight, []).append(i)
    c = len(outlook.parameters)
    found = np.zeros((len(candidates), c, c))
    for sights in places.values():
        first = candidates[next(iter(sights.values()))[0]]
        with _naming(first):
            place = outlook.at(first.posture)
        for (frame, impact, lines), members in sights.items():
            options = [candidates[i] for i in members]
            outputs = tuple(dict.fromkeys(axis for option in options for axis in option.outputs))
            inputs = tuple(dict.fromkeys(axis for option in options for axis in option.inputs))
            with _naming(options[0]):
                _, D, _ = outlook.seen(place, np.frombuffer(lines), frame, outputs, inputs, impact)
            for i, option in zip(members, options, strict=True):
                rows, columns = ([of.index(axis) for axis in axes] for of, axes in (
                    (outputs, option.outputs), (inputs, option.inputs)
                ))  # fmt: skip
                found[i] = information(D[:, rows][:, :, columns])
    return found


@contextmanager
def _naming(candidate: Candidate) -> Iterator[None]:
    """Errors that name the candidate."""
    where = f"candidate {candidate.label}"
    try:
        yield
    except ArmonicError as error:
        raise UpdateError(
            where, found=f"{error.where}: {error.found}", expected=error.expected, hint=error.hint
        ) from None
    except ArithmeticError as error:
        raise UpdateError(where, found=str(error), expected="another posture") from None
