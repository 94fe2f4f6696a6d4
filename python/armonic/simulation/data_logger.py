"""A data logger on a robot that is tapped: hammer and accelerometers through filters and converters into records."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from armonic.errors import SimulationError
from armonic.frf_set import split_label
from armonic.series import Channel, TimeSeries
from armonic.simulation.hammer import AXES, Blow, refuse_unless
from armonic.simulation.running import samples_of, simulate
from armonic.simulation.sensors import AntiAlias, Sensor, measure
from armonic.simulation.signals import notes_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from armonic.linear import Posture
    from armonic.robot import Robot
    from armonic.simulation.joints import JointLaw

    Array: TypeAlias = NDArray[np.float64]

FINE = 8
"""Means over a fine step that the anti-alias filter sees per sample."""
HIT = "hit"
"""The note that says how a record's hits were given."""
SEED = "seed"
"""The note that holds the seed."""


@dataclass(frozen=True)
class Converter:
    """How signals become samples.

    Attributes:
        sample_rate_hz: samples per second.
        bits: of every channel; None: no steps, and no end of the range.
        noise: standard deviation of force (N) and acceleration (m/s²).
        ranges: the largest force and acceleration, ±.
        anti_alias: the filter ahead, the same for all channels.
    """

    sample_rate_hz: float
    bits: int | None
    noise: tuple[float, float]
    ranges: tuple[float, float]
    anti_alias: AntiAlias

    def __post_init__(self) -> None:
        refuse_unless("sample_rate_hz", self.sample_rate_hz, 0.0, above=True)
        for name, value in zip(("force_noise_n", "noise"), self.noise, strict=True):
            refuse_unless(name, value, 0.0)
        for name, value in zip(("force_range_n", "acceleration_range"), self.ranges, strict=True):
            refuse_unless(name, value, 0.0, above=True)

    @property
    def sensors(self) -> dict[str, Sensor]:
        """By quantity."""
        return {
            quantity: Sensor(self.bits, 2 * most, saturates=True, noise_std=std, anti_alias=self.anti_alias)
            for quantity, most, std in zip(("force", "acceleration"), self.ranges, self.noise, strict=True)
        }


@dataclass(frozen=True, eq=False)
class DataLogger:
    """A robot with its sensors, ready to be hit.

    Attributes:
        robot: the robot.
        posture: where it rests before every record.
        sensors: degrees of freedom watched.
        joints: what is not linear in its joints.
        converter: how signals become samples.
        record_s: length of a record.
        seed: of the noise.
    """

    robot: Robot
    posture: Posture
    sensors: tuple[str, ...]
    joints: tuple[JointLaw, ...]
    converter: Converter
    record_s: float
    seed: int

    @property
    def fine_samples(self) -> int:
        """How many fine steps a record has.

        Raises:
            SimulationError: they are too many.
        """
        steps = samples_of(self.record_s, FINE * self.converter.sample_rate_hz)[0] - 1
        return steps // FINE * FINE

    def record(self, number: int, blows: tuple[Blow, ...]) -> TimeSeries | None:
        """What is recorded of some hits on one point.

        The filter sees means over fine steps, exactly: those of the force from its impulse, those of the acceleration
        from the velocity. Hardly anything beyond the fine rate can then fold down, and what the means take off is the
        same of all channels.

        Args:
            number: of the record, which makes its noise.
            blows: the hits.

        Returns:
            Force and accelerations; None if the run was interrupted.

        Raises:
            SimulationError: a hit was too hard for the joints.
        """
        rate, steps, places = FINE * self.converter.sample_rate_hz, self.fine_samples, list(by_place(self.sensors))
        pulses = [pulse for blow in blows for pulse in blow.pulses()]
        try:
            run = simulate(
                self.robot,
                self.posture,
                pulses,
                duration_s=steps / rate,
                sample_rate_hz=rate,
                frames=places,
                joints=self.joints,
            )
        except SimulationError as error:
            if error.run is None:
                raise
            hint = "Hit less hard, or let the joints soften less."
            where = f"{error.where}, {blows[0]}"
            raise SimulationError(where, found=error.found, expected=error.expected, hint=hint) from error
        if run.status == "interrupted" or len(run.series) <= steps:
            return None
        force = np.diff(np.sum([blow.impulse(np.arange(steps + 1) / rate) for blow in blows], axis=0)) * rate
        q = self.robot.posture(self.posture)
        motion: dict[str, Array] = {}
        for place in places:
            velocity = run.series.select(*(f"velocity:{place}.{axis}0" for axis in AXES)).values
            turn = self.robot.mechanism.pose(q, self.robot.frame_index(place))[:3, :3]
            change = np.diff(velocity @ turn, axis=0) * rate
            motion.update({f"{place}.{axis}": change[:, k] for k, axis in enumerate(AXES)})
        channels = (
            Channel(blows[0].point, "force", "N"),
            *(Channel(label, "acceleration", "m/s²") for label in self.sensors),
        )
        notes = notes_of(self.robot, run.posture, q, pulses, steps / rate)
        notes |= {HIT: "; ".join(map(str, blows)), SEED: str(self.seed)}
        values = np.column_stack([force, *(motion[label] for label in self.sensors)])
        noise_seed = int(np.random.default_rng([self.seed, number]).integers(2**32))
        truth = TimeSeries(values, rate, channels, notes=notes)
        return measure(truth, self.converter.sensors, decimation=FINE, seed=noise_seed)

    def judged(self, record: TimeSeries, blows: tuple[Blow, ...]) -> tuple[Blow, ...]:
        """The hits of a record, and of which of them a channel came to the end of its range."""
        if self.converter.bits is None:
            return blows
        sensors = self.converter.sensors
        ends = [sensors[channel.quantity] for channel in record.channels]
        most = np.array([sensor.full_range / 2 - 1.5 * sensor.step for sensor in ends])
        cut = np.any(np.abs(record.values) >= most, axis=1)
        first = [math.floor(blow.start_s * record.sample_rate_hz) for blow in blows]
        spans = zip(first, [*first[1:], len(record)], strict=True)
        return tuple(
            replace(blow, overloaded=bool(np.any(cut[start:stop])))
            for blow, (start, stop) in zip(blows, spans, strict=True)
        )


def by_place(labels: Sequence[str]) -> dict[str, list[str]]:
    """The axes of each place, in order."""
    found: dict[str, list[str]] = {}
    for label in labels:
        place, axis = split_label(label)
        found.setdefault(place, []).append(axis)
    return found
