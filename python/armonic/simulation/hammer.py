"""The blows of a modal hammer as a person gives them: scattered in force, contact, direction and place."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from armonic.errors import SimulationError
from armonic.frf_set import split_label
from armonic.simulation.control import is_number
from armonic.simulation.excitations import HammerPulse

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    Array: TypeAlias = NDArray[np.float64]

Sort = Literal["single", "double", "overload"]
"""Whether a blow is as it should be, rebounds, or is too hard for the range of the force."""

AXES = ("x", "y", "z")
SCATTER_MOST = 2.5
"""Standard deviations: nobody who practised hits farther off than that."""
REBOUND_AFTER = (3.0, 8.0)
"""The second contact of a double hit begins so many contact times after the first."""
REBOUND_SHARE = (0.2, 0.5)
"""Its peak as a share of the first."""
OVERLOAD = (1.7, 2.0)
"""The peak of a blow that is too hard, as a share of the range of the force."""


@dataclass(frozen=True)
class Hammer:
    """A hammer and the hand that holds it.

    Attributes:
        force_n: median of the peak force, N.
        spread: standard deviation of the peak's logarithm: 0.25 is about a quarter of it.
        pulse_s: median of the contact time, which the tip decides, s.
        pulse_spread: standard deviation of its logarithm.
        tilt_rad: standard deviation of the direction about each of the two axes across it.
        offset_m: standard deviation of the place along each of these axes.
    """

    force_n: float
    spread: float
    pulse_s: float
    pulse_spread: float
    tilt_rad: float
    offset_m: float

    def __post_init__(self) -> None:
        for name in ("force_n", "pulse_s"):
            refuse_unless(name, getattr(self, name), 0.0, above=True)
        for name in ("spread", "pulse_spread", "tilt_rad", "offset_m"):
            refuse_unless(name, getattr(self, name), 0.0)


@dataclass(frozen=True)
class Blow:
    """One blow, exactly as it was given.

    Attributes:
        point: the degree of freedom that was aimed at, "sensor.x".
        sort: "single"; "double" for one that rebounds and hits again; "overload" for one beyond the range.
        start_s: when the contact begins, in the time of its record.
        peak_n: of the force along the hammer, which is what the hammer measures.
        pulse_s: contact time.
        direction: of the hammer, unit vector in the axes of the point's frame.
        offset_m: where it hits, from the frame's origin, in its axes.
        rebound_s: when the second contact begins; 0 if there is none.
        rebound_n: its peak.
        overloaded: whether a measured channel came to the end of its range.
    """

    point: str
    sort: Sort
    start_s: float
    peak_n: float
    pulse_s: float
    direction: tuple[float, ...]
    offset_m: tuple[float, ...]
    rebound_s: float = 0.0
    rebound_n: float = 0.0
    overloaded: bool = False

    def __str__(self) -> str:
        """One line on what was done."""
        again = f", again with {self.rebound_n:.4g} N at {self.rebound_s:.4g} s" if self.sort == "double" else ""
        over = ", overload" if self.overloaded else ""
        contact = f"{self.peak_n:.4g} N for {1e3 * self.pulse_s:.3g} ms at {self.start_s:.4g} s"
        return f"hit at {self.point}: {contact}{again}{over}"

    @property
    def contacts(self) -> tuple[tuple[float, float], ...]:
        """Start and peak force of each contact."""
        first = ((self.start_s, self.peak_n),)
        return (*first, (self.rebound_s, self.rebound_n)) if self.sort == "double" else first

    def pulses(self) -> list[HammerPulse]:
        """What acts on the robot: half sines of the force's parts, and of its moments about the frame's origin."""
        frame, _ = split_label(self.point)
        wrench = np.concatenate([self.direction, np.cross(self.offset_m, self.direction)])
        parts = [
            (axis, float(part)) for axis, part in zip((*AXES, *(f"r{a}" for a in AXES)), wrench, strict=True) if part
        ]
        return [
            HammerPulse(axis=axis, frame=frame, force=part * peak, duration_s=self.pulse_s, start_s=start)
            for start, peak in self.contacts
            for axis, part in parts
        ]

    def impulse(self, time_s: ArrayLike) -> Array:
        """The time integral of the force along the hammer up to some times, N s."""
        time = np.asarray(time_s, np.float64)
        total = np.zeros(time.shape)
        for start, peak in self.contacts:
            phase = np.pi * np.clip((time - start) / self.pulse_s, 0.0, 1.0)
            total += peak * self.pulse_s / np.pi * (1 - np.cos(phase))
        return total


def mean_blow(point: str, hammer: Hammer, start_s: float) -> Blow:
    """A blow without any scatter."""
    axis = split_label(point)[1]
    x, y, z = (float(axis == a) for a in AXES)
    return Blow(point, "single", start_s, hammer.force_n, hammer.pulse_s, (x, y, z), (0.0, 0.0, 0.0))


def draw_blows(
    point: str, sorts: Sequence[Sort], hammer: Hammer, starts_s: Array, range_n: float, seed: int
) -> tuple[Blow, ...]:
    """The blows on one point; they depend on seed and point alone, and more of them change none of the first.

    Args:
        point: the degree of freedom aimed at.
        sorts: one per blow.
        hammer: what scatters, and by how much.
        starts_s: (blows,) when each begins.
        range_n: of the force; blows that are too hard go beyond it.
        seed: of the scatter.
    """
    generator = np.random.default_rng([seed, *point.encode()])
    along = AXES.index(split_label(point)[1])
    across = [k for k in range(3) if k != along]
    blows = []
    for sort, start_s in zip(sorts, starts_s.tolist(), strict=True):
        z = np.clip(generator.normal(size=6), -SCATTER_MOST, SCATTER_MOST)
        after, share, beyond = (generator.uniform(*ends) for ends in (REBOUND_AFTER, REBOUND_SHARE, OVERLOAD))
        peak_n = range_n * beyond if sort == "overload" else hammer.force_n * np.exp(hammer.spread * z[0])
        pulse_s = hammer.pulse_s * np.exp(hammer.pulse_spread * z[1])
        direction, offset = np.zeros(3), np.zeros(3)
        direction[along] = 1.0
        direction[across] = np.tan(hammer.tilt_rad * z[2:4])
        offset[across] = hammer.offset_m * z[4:6]
        direction /= np.linalg.norm(direction)
        blow = Blow(
            point=point,
            sort=sort,
            start_s=start_s,
            peak_n=float(peak_n),
            pulse_s=float(pulse_s),
            direction=tuple(direction.tolist()),
            offset_m=tuple(offset.tolist()),
        )
        if sort == "double":
            again_s, again_n = start_s + after * pulse_s, share * peak_n
            blow = replace(blow, rebound_s=float(again_s), rebound_n=float(again_n))
        blows.append(blow)
    return tuple(blows)


def refuse_unless(name: str, value: object, least: float, *, above: bool = False, most: float = math.inf) -> None:
    """Refuse an argument of a tap test that is no finite number, or not within its bounds.

    Raises:
        SimulationError: it is not.
    """
    if is_number(value) and (value > least if above else value >= least) and value <= most:  # type: ignore[operator]
        return
    bound = f"above {least:g}" if above else f"of at least {least:g}"
    bound += "" if most == math.inf else f" and at most {most:g}"
    raise SimulationError(name, found=repr(value), expected=f"a finite number {bound}")


def refuse_unless_whole(name: str, value: object, least: int) -> None:
    """Refuse an argument that is no whole number, or too small.

    Raises:
        SimulationError: it is not.
    """
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
        raise SimulationError(name, found=repr(value), expected=f"a whole number of at least {least}")
