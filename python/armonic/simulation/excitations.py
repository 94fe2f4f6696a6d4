"""Forces and moments that excite a robot over time: what they are, where they act, and how the core is told."""

from __future__ import annotations

import math
import re
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, TypeAlias

import numpy as np

from armonic.errors import SimulationError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from armonic.robot import Robot

    Array: TypeAlias = NDArray[np.float64]
    Waveform: TypeAlias = tuple[str, list[float], list[float]]
    CoreExcitation: TypeAlias = tuple[int, list[float], bool, str, list[float], list[float]]

_AXIS = re.compile(r"(r?)([xyz])(0?)")
MAX_SAMPLES = 20_000_000
"""Of a run, of noise, or of control: more is taken for an error in a unit."""
SAMPLES_PER_PERIOD = 20
"""Noise is made so finely that straight lines between its values lose less than 1 % of its highest frequency."""


@dataclass(frozen=True, kw_only=True)
class Excitation(ABC):
    """A force or moment along one axis of a frame.

    Attributes:
        axis: "x", "y", "z" for a force along an axis of the frame, "rx", "ry", "rz" for a moment about it; with a 0
            behind it ("y0") the axis of the world.
        frame: where it acts; None: at the only frame that the robot file defines.
    """

    axis: str
    frame: str | None = None

    name: ClassVar[str] = "excitation"

    def __post_init__(self) -> None:
        if not (isinstance(self.axis, str) and _AXIS.fullmatch(self.axis)):
            raise SimulationError(
                f"{self.name}.axis",
                found=repr(self.axis),
                expected="x, y, z, rx, ry or rz of the frame, or x0, ... rz0 of the world",
            )
        self._check()

    @abstractmethod
    def _check(self) -> None:
        """Refuse numbers that make no such excitation."""

    @property
    def unit(self) -> str:
        """Of its values: "N" for a force, "N m" for a moment."""
        return "N m" if self.axis.startswith("r") else "N"

    @abstractmethod
    def waveform(self, duration_s: float) -> Waveform:
        """Kind, numbers and samples of the waveform, as the core takes them, for a run of some length.

        Raises:
            SimulationError: it does not last as long.
        """

    def frame_on(self, robot: Robot) -> str:
        """The name of the frame at which it acts.

        Raises:
            SimulationError: none is given, and the robot file does not define exactly one.
            PostureError: the robot has no such frame.
        """
        if self.frame is not None:
            robot.frame_index(self.frame)
            return self.frame
        return only_frame(robot, f"{self.name}.frame")

    def on(self, robot: Robot, duration_s: float) -> CoreExcitation:
        """Frame, direction, whether it turns with the frame, and waveform, as the core takes them."""
        moment, axis, world = _AXIS.fullmatch(self.axis).groups()  # type: ignore[union-attr]  # checked when made
        direction = [0.0] * 6
        direction["xyz".index(axis) + (3 if moment else 0)] = 1.0
        return (robot.frame_index(self.frame_on(robot)), direction, not world, *self.waveform(duration_s))


@dataclass(frozen=True, kw_only=True)
class Impulse(Excitation):
    """A constant force for a short while, as in Do et al. 2022, section 4.3.

    Attributes:
        force: N, or N m.
        duration_s: how long it acts.
        start_s: when it begins.
    """

    force: float
    duration_s: float
    start_s: float = 0.2

    name: ClassVar[str] = "Impulse"

    def _check(self) -> None:
        refuse_unless(self, "force")
        refuse_unless(self, "start_s", least=0.0)
        refuse_unless(self, "duration_s", above=0.0)

    def waveform(self, duration_s: float) -> Waveform:
        """A constant from start to end."""
        return "constant", [self.start_s, self.start_s + self.duration_s, self.force], []


@dataclass(frozen=True, kw_only=True)
class HammerPulse(Excitation):
    """Half a sine, the force of a modal hammer.

    Attributes:
        force: peak, N.
        duration_s: of the contact.
        start_s: when it begins.
    """

    force: float
    duration_s: float
    start_s: float = 0.2

    name: ClassVar[str] = "HammerPulse"

    def _check(self) -> None:
        refuse_unless(self, "force")
        refuse_unless(self, "start_s", least=0.0)
        refuse_unless(self, "duration_s", above=0.0)

    def waveform(self, duration_s: float) -> Waveform:
        """Half a sine from start to end."""
        return "half-sine", [self.start_s, self.start_s + self.duration_s, self.force], []


@dataclass(frozen=True, kw_only=True)
class Step(Excitation):
    """A force that sets in and stays.

    Attributes:
        force: N, or N m.
        start_s: when it sets in.
    """

    force: float
    start_s: float = 0.2

    name: ClassVar[str] = "Step"

    def _check(self) -> None:
        refuse_unless(self, "force")
        refuse_unless(self, "start_s", least=0.0)

    def waveform(self, duration_s: float) -> Waveform:
        """A constant without an end."""
        return "constant", [self.start_s, math.inf, self.force], []


@dataclass(frozen=True, kw_only=True)
class Sine(Excitation):
    """A sine, such as the unbalance of a spindle.

    Attributes:
        force: amplitude, N or N m.
        freq_hz: its frequency.
        phase_rad: at the start.
        start_s: when it begins.
        stop_s: when it ends; None: never.
    """

    force: float
    freq_hz: float
    phase_rad: float = 0.0
    start_s: float = 0.0
    stop_s: float | None = None

    name: ClassVar[str] = "Sine"

    def _check(self) -> None:
        for field_name in ("force", "freq_hz", "phase_rad"):
            refuse_unless(self, field_name)
        refuse_unless(self, "start_s", least=0.0)
        _ends(self)

    def waveform(self, duration_s: float) -> Waveform:
        """A sine from start to stop."""
        end = math.inf if self.stop_s is None else self.stop_s
        return "sine", [self.start_s, end, self.force, self.freq_hz, self.phase_rad], []


@dataclass(frozen=True, kw_only=True)
class Sweep(Excitation):
    """A sine whose frequency runs evenly, or by even factors, from one value to another.

    Attributes:
        force: amplitude, N or N m.
        from_hz: frequency at the start.
        to_hz: frequency at the end.
        logarithmic: whether the frequency grows by the same factor per second; else by the same number.
        start_s: when it begins.
        stop_s: when it ends; None: with the run.
    """

    force: float
    from_hz: float
    to_hz: float
    logarithmic: bool = False
    start_s: float = 0.0
    stop_s: float | None = None

    name: ClassVar[str] = "Sweep"

    def _check(self) -> None:
        refuse_unless(self, "force")
        refuse_unless(self, "start_s", least=0.0)
        for field_name in ("from_hz", "to_hz"):
            refuse_unless(self, field_name, above=0.0 if self.logarithmic else None, least=0.0)
        _ends(self)

    def waveform(self, duration_s: float) -> Waveform:
        """A sweep from start to stop, or to the end of the run."""
        end = max(duration_s, self.start_s) if self.stop_s is None else self.stop_s
        return "sweep", [self.start_s, end, self.force, self.from_hz, self.to_hz, float(self.logarithmic)], []


@dataclass(frozen=True, kw_only=True)
class BandNoise(Excitation):
    """Gaussian noise of even power over a band of frequencies.

    Attributes:
        rms: effective value, N or N m.
        low_hz: lower end of the band.
        high_hz: upper end.
        seed: of the random numbers; the same seed, band and duration give the same noise. None: the place among the
            excitations of a run, so that several are independent.
        start_s: when it begins.
    """

    rms: float
    low_hz: float
    high_hz: float
    seed: int | None = None
    start_s: float = 0.0

    name: ClassVar[str] = "BandNoise"

    def _check(self) -> None:
        refuse_unless(self, "rms", least=0.0)
        refuse_unless(self, "low_hz", least=0.0)
        refuse_unless(self, "high_hz", above=self.low_hz)
        refuse_unless(self, "start_s", least=0.0)

    def waveform(self, duration_s: float) -> Waveform:
        """Samples whose spectrum has random phases and amplitudes within the band, and nothing outside."""
        step = 1 / (SAMPLES_PER_PERIOD * self.high_hz)
        if self.start_s >= duration_s:
            return "samples", [self.start_s, step], [0.0, 0.0]
        if (duration_s - self.start_s) / step > MAX_SAMPLES:
            raise SimulationError(
                "BandNoise.high_hz",
                found=f"{self.high_hz:g} Hz for {duration_s - self.start_s:g} s",
                expected=f"noise of at most {MAX_SAMPLES} samples, {SAMPLES_PER_PERIOD} a period",
            )
        count = max(2, math.ceil((duration_s - self.start_s) / step) + 2)
        lines = np.fft.rfftfreq(count, step)
        inside = (lines >= self.low_hz) & (lines <= self.high_hz)
        if not inside.any():
            raise SimulationError(
                "BandNoise",
                found=f"{self.low_hz:g} to {self.high_hz:g} Hz for {duration_s - self.start_s:g} s",
                expected="a band with at least one line, one over the duration apart",
                hint="Widen the band or lengthen the run.",
            )
        random = np.random.default_rng(0 if self.seed is None else self.seed)
        spectrum = np.zeros(len(lines), np.complex128)
        spectrum[inside] = random.normal(size=(2, int(inside.sum()))).T @ [1, 1j]
        values = np.fft.irfft(spectrum, count)
        return "samples", [self.start_s, step], (values * (self.rms / np.sqrt(np.mean(values**2)))).tolist()


def only_frame(robot: Robot, where: str) -> str:
    """The one frame that a robot file defines.

    Raises:
        SimulationError: it defines none or several.
    """
    names = [entry.name for entry in robot.description.frames]
    if len(names) != 1:
        raise SimulationError(where, found="none", expected=f"one of {', '.join(names or robot.frames)}")
    return names[0]


def refuse_unless(excitation: Excitation, name: str, *, least: float | None = None, above: float | None = None) -> None:
    """Refuse a number of an excitation that is not finite, or not within its bounds."""
    value = getattr(excitation, name)
    number = isinstance(value, int | float | np.number) and not isinstance(value, bool) and math.isfinite(value)
    if number and (least is None or value >= least) and (above is None or value > above):
        return
    bound = f" above {above:g}" if above is not None else f" of at least {least:g}" if least is not None else ""
    where = f"{excitation.name}.{name}"
    raise SimulationError(where, found=repr(value), expected=f"a finite number{bound}")


def _ends(excitation: Sine | Sweep) -> None:
    if excitation.stop_s is not None:
        refuse_unless(excitation, "stop_s", above=excitation.start_s)
