"""The exceptions that Armonic raises on bad input; every message says where, what was found and what to do."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from armonic.simulation.running import Run


class ArmonicError(ValueError):
    """Base of every error that Armonic raises on purpose.

    The message is one line: where the fault is, what was found, what was expected, and (if given) a hint
    what to do next. The parts stay readable as attributes, for programs.

    Args:
        where: the place: a file and line, a dotted path into the description, or an argument's name.
        found: what stands there.
        expected: what should stand there, with its unit.
        hint: what to do about it, as a full sentence.
    """

    def __init__(self, where: str, *, found: str, expected: str, hint: str | None = None) -> None:
        self.where, self.found, self.expected, self.hint = where, found, expected, hint
        message = f"{where}: found {found}, expected {expected}."
        super().__init__(message if hint is None else f"{message} {hint}")

    def __reduce__(self) -> tuple[object, ...]:
        """Made again from its parts, so that it crosses to another process."""
        return _made_again, (type(self), self.where, self.found, self.expected, self.hint), self.__dict__


def _made_again(kind: type[ArmonicError], where: str, found: str, expected: str, hint: str | None) -> ArmonicError:
    return kind(where, found=found, expected=expected, hint=hint)


class RobotFileError(ArmonicError):
    """The robot description is malformed or physically impossible.

    Attributes:
        errors: where a file has several, all that were found, in its order; empty if this is the only one.
    """

    errors: tuple[RobotFileError, ...] = ()


class PostureError(ArmonicError):
    """A posture, velocity, wrench or frame does not fit the robot."""


class ModelError(ArmonicError):
    """A computation has no answer for this model (singular mass matrix, no equilibrium, resonance hit exactly)."""


class DataFileError(ArmonicError):
    """A measurement file cannot be read or written."""


class FrfError(ArmonicError):
    """The arrays or labels of a frequency response do not fit each other or the task."""


class UpdateError(ArmonicError):
    """A fitting problem is not well posed: parameters, bounds, weights or measurements."""


class SurveyError(ArmonicError):
    """A survey cannot be made as it is asked for, or its store belongs to another one."""


class SignalError(ArmonicError):
    """A time series, or what is asked of it, does not make sense: channels, sampling, orders or samples."""


class SimulationError(ArmonicError):
    """A run in time cannot be done as asked, or came to a state that no robot reaches.

    Attributes:
        run: what was computed of a run before it came there; None where nothing was run.
    """

    run: Run | None = None
