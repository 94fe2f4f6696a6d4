"""A virtual tap test: the simulated robot hit by a hammer, and the records that a data logger makes of it."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from armonic.errors import ArmonicError, SimulationError
from armonic.files.measured_file import Geometry
from armonic.frf_set import FrfSet, split_label
from armonic.linear import linearize
from armonic.modal import modes
from armonic.simulation.data_logger import Converter, DataLogger, by_place
from armonic.simulation.excitations import only_frame
from armonic.simulation.hammer import (
    AXES,
    Blow,
    Hammer,
    Sort,
    draw_blows,
    mean_blow,
    refuse_unless,
    refuse_unless_whole,
)
from armonic.simulation.linear_response import linear_response
from armonic.simulation.sensors import AntiAlias
from armonic.simulation.softening import softening_laws
from armonic.synthesis import frf

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from armonic.linear import LinearModel, Posture
    from armonic.modal import Modes
    from armonic.response import Kind
    from armonic.robot import Robot
    from armonic.series import TimeSeries
    from armonic.simulation.joints import JointLaw

    Array: TypeAlias = NDArray[np.float64]

ANTI_ALIAS = AntiAlias(cutoff=0.5, order=8, kind="bessel")
"""Without overshoot, which a short pulse would make look like a double hit; 3e-5 of what lies above folds down."""
LATE = 0.05
"""Of several hits in a record, each comes late by up to this share of the time between them."""
HEADROOM = 2.0
"""A range reaches this far beyond the peak of a mean hit, unless it is given."""
REHEARSED_PERIODS = 5
"""Of the slowest mode: within them everything has swung its farthest."""
LONGEST_PULSE = 0.1
"""Share of a record that a contact may last."""
SOFTENING_MOST = 0.03
"""More, and a hard hit would push a cubic spring over its top."""


@dataclass(frozen=True, eq=False, repr=False)
class TapTest:
    """Records of a virtual tap test, and the truth behind them.

    Attributes:
        records: of every hit, or of all hits on a point: channels "force:POINT" in N and "acceleration:SENSOR" in m/s².
        blows: for each record its hits as they were given.
        robot: the robot, whose small motions are linear.
        model: it, linearized at the posture.
        modes: its modes there.
        points: degrees of freedom hit.
        sensors: degrees of freedom watched.
        joints: laws of joints that are not linear, those of `softening` among them.
        force_range_n: largest force that can be measured, ±.
        acceleration_range: largest acceleration, ± m/s².
        status: "complete", or "interrupted" after Ctrl-C; then the last hits are missing.
        seconds: how long it took.
    """

    records: tuple[TimeSeries, ...]
    blows: tuple[tuple[Blow, ...], ...]
    robot: Robot
    model: LinearModel
    modes: Modes
    points: tuple[str, ...]
    sensors: tuple[str, ...]
    joints: tuple[JointLaw, ...]
    force_range_n: float
    acceleration_range: float
    status: Literal["complete", "interrupted"]
    seconds: float

    def __repr__(self) -> str:
        """Robot, posture, hits and records in one line."""
        hits = sum(map(len, self.blows))
        return (
            f"TapTest({self.robot.name}, posture {self.posture}: {hits} hits at {', '.join(self.points)}, "
            f"{len(self.records)} records, {self.status})"
        )

    @property
    def posture(self) -> str:
        """What the posture is called."""
        return self.model.posture

    @property
    def geometry(self) -> Geometry:
        """Where the points and sensors are in the posture."""
        places = tuple(dict.fromkeys(split_label(label)[0] for label in (*self.points, *self.sensors)))
        pose = self.robot.mechanism.pose
        return Geometry(
            places, np.array([pose(self.model.q, self.robot.frame_index(place))[:3, 3] for place in places])
        )

    def frf(self, freq_hz: ArrayLike, kind: Kind = "accelerance") -> FrfSet:
        """The true responses of the linear robot from every point to every sensor (Huynh et al. 2021, Eq. 28).

        Args:
            freq_hz: lines, (L,), Hz, increasing.
            kind: "receptance", "mobility" or "accelerance".

        Raises:
            FrfError: the lines are not valid.
            ModelError: an undamped resonance lies exactly on a line.
        """
        rows, columns = by_place(self.sensors), by_place(self.points)
        blocks = [
            [
                frf(self.model, None, freq_hz, frame=watched, kind=kind, outputs=o, inputs=i, input_frame=hit)
                for hit, i in columns.items()
            ]
            for watched, o in rows.items()
        ]
        values = np.concatenate([np.concatenate([b.values for b in row], axis=2) for row in blocks], axis=1)
        outputs, inputs = ([f"{p}.{axis}" for p, axes in side.items() for axis in axes] for side in (rows, columns))
        found = FrfSet(blocks[0][0].freq_hz, values, kind, tuple(outputs), tuple(inputs))
        order = [outputs.index(label) for label in self.sensors], [inputs.index(label) for label in self.points]
        notes = {"robot": self.robot.name, "posture": self.posture}
        values = found.values[:, order[0]][:, :, order[1]]
        return replace(found, values=values, outputs=self.sensors, inputs=self.points, notes=notes)


def tap_test(
    robot: Robot,
    posture: Posture,
    *,
    points: str | Sequence[str] | None = None,
    sensors: str | Sequence[str] | None = None,
    hits: int = 5,
    force_n: float = 200.0,
    spread: float = 0.25,
    pulse_s: float = 0.01,
    pulse_spread: float = 0.05,
    tilt_rad: float = 0.02,
    offset_m: float = 0.002,
    double_hits: int = 0,
    overloads: int = 0,
    softening: float = 0.0,
    joints: JointLaw | Sequence[JointLaw] = (),
    sample_rate_hz: float = 512.0,
    record_s: float = 8.0,
    pretrigger_s: float = 0.1,
    one_record_per_hit: bool = True,
    noise: float = 1e-3,
    force_noise_n: float = 0.05,
    bits: int | None = 24,
    force_range_n: float | None = None,
    acceleration_range: float | None = None,
    anti_alias: AntiAlias | None = None,
    seed: int = 0,
    progress: Callable[[int, int], object] | None = None,
) -> TapTest:
    """Rehearses a tap test on a robot: hits it by a hammer, point after point, and records force and acceleration.

    The robot is the full nonlinear one of `simulate`, at rest before each record. Hammer and accelerometers see their
    signals through the same anti-alias filter, so that it cancels in every FRF. Accelerometers have the axes of their
    frames at rest and see no gravity.

    With joints that soften, FRFs depend on how hard was hit: coherence falls at resonances, which lie lower than those
    of the linear robot, and cross FRFs lose their symmetry, as Huynh et al. 2021 report in section 5.2.

    Args:
        robot: the robot.
        posture: where it is tapped.
        points: degrees of freedom to hit one after the other, PLACE.AXIS with the axis x, y or z of a frame; a hammer
            roves by naming several frames. Default: x, y and z of the only frame that the robot file defines.
        sensors: degrees of freedom watched at once. Default: x, y and z of the same frame.
        hits: on each point.
        force_n: median of the peak force, N.
        spread: standard deviation of the peak's logarithm.
        pulse_s: median of the contact time of half a sine, s: 5 to 10 ms of a soft tip, 1 to 2 ms of a hard one.
        pulse_spread: standard deviation of its logarithm.
        tilt_rad: standard deviation of the hammer's direction about each axis across it.
        offset_m: standard deviation of where it hits, along each of these axes.
        double_hits: how many of all hits rebound, chosen by the seed.
        overloads: how many of all hits are too hard for the range of the force.
        softening: the share by which every spring of a joint is softer when it swings as far as a mean hit makes it,
            at the point that moves it most; modes then lie lower by half of it at most. 0 to 0.03.
        joints: further laws of joints: backlash, friction.
        sample_rate_hz: samples per second of the records.
        record_s: length of a record; with several hits in one, the time from one to the next.
        pretrigger_s: from the start of a record to its first hit.
        one_record_per_hit: else the hits on a point are one record, and the robot has `record_s` to come to rest.
        noise: standard deviation of the accelerometers' noise, m/s².
        force_noise_n: standard deviation of the hammer's noise, N.
        bits: of the converter; None: no steps, and no end of the range.
        force_range_n: largest force that it takes, ±. Default: twice that of a mean hit.
        acceleration_range: largest acceleration, ± m/s². Default: twice that of a mean hit on the linear robot.
        anti_alias: the filter ahead of it. Default: a Bessel filter of order 8 at half the Nyquist frequency.
        seed: of all scatter and noise; a point's hits depend on no other point.
        progress: called after each record with how many are done, and of how many; what it raises ends the test.

    Returns:
        The records. Ctrl-C ends the test early, with the records that were complete.

    Raises:
        PostureError: the posture does not fit the robot.
        SimulationError: an argument does not make sense, or a hit was too hard for the joints.
        ModelError: the robot cannot be linearized.
    """
    began = time.perf_counter()
    hit, watched = _labels(robot, "points", points), _labels(robot, "sensors", sensors)
    hammer = Hammer(force_n, spread, pulse_s, pulse_spread, tilt_rad, offset_m)
    refuse_unless("softening", softening, 0.0, most=SOFTENING_MOST)
    refuse_unless("record_s", record_s, 0.0, above=True)
    refuse_unless("pulse_s", pulse_s, 0.0, above=True, most=LONGEST_PULSE * record_s)
    refuse_unless("pretrigger_s", pretrigger_s, 0.0, most=record_s / 2)
    refuse_unless_whole("seed", seed, 0)
    sorts = _sorts(len(hit), hits, double_hits, overloads, seed)
    if overloads and bits is None:
        raise SimulationError("overloads", found="a converter without bits", expected="bits, for its range to end")
    model = linearize(robot, posture)
    own = modes(model)
    swing, most = _rehearsal(robot, posture, own, hit, watched, hammer, record_s)
    further = joints if isinstance(joints, Iterable) else (joints,)
    ranges = (
        HEADROOM * force_n if force_range_n is None else force_range_n,
        (HEADROOM * most or 1.0) if acceleration_range is None else acceleration_range,
    )
    logger = DataLogger(
        robot=robot,
        posture=posture,
        sensors=watched,
        joints=(*softening_laws(robot, swing, softening), *further),
        converter=Converter(sample_rate_hz, bits, (force_noise_n, noise), ranges, anti_alias or ANTI_ALIAS),
        record_s=record_s if one_record_per_hit else hits * record_s,
        seed=seed,
    )
    plan: list[tuple[Blow, ...]] = []
    for point, of_point in zip(hit, sorts, strict=True):
        starts_s = _starts(point, hits, pretrigger_s, record_s, pulse_s, seed, apart=one_record_per_hit)
        blows = draw_blows(point, of_point, hammer, starts_s, ranges[0], seed)
        plan += [(blow,) for blow in blows] if one_record_per_hit else [blows]
    records: list[TimeSeries] = []
    given: list[tuple[Blow, ...]] = []
    try:
        for k, blows in enumerate(plan):
            taken = logger.record(k, blows)
            if taken is None:
                break
            records.append(taken)
            given.append(logger.judged(taken, blows))
            if progress is not None:
                progress(len(records), len(plan))
    except KeyboardInterrupt:
        pass
    if not records:
        raise KeyboardInterrupt
    return TapTest(
        records=tuple(records),
        blows=tuple(given),
        robot=robot,
        model=model,
        modes=own,
        points=hit,
        sensors=watched,
        joints=logger.joints,
        force_range_n=ranges[0],
        acceleration_range=ranges[1],
        status="complete" if len(records) == len(plan) else "interrupted",
        seconds=time.perf_counter() - began,
    )


def _sorts(points: int, hits: int, double_hits: int, overloads: int, seed: int) -> list[list[Sort]]:
    """Which hits on each point go wrong, and how."""
    refuse_unless_whole("hits", hits, 1)
    refuse_unless_whole("double_hits", double_hits, 0)
    refuse_unless_whole("overloads", overloads, 0)
    total = points * hits
    if double_hits + overloads > total:
        found = f"{double_hits} double hits and {overloads} overloads"
        raise SimulationError("double_hits", found=found, expected=f"no more than the {total} hits together")
    sorts: list[Sort] = ["single"] * total
    wrong = np.random.default_rng([seed, hits]).permutation(total).tolist()[: double_hits + overloads]
    for place, k in enumerate(wrong):
        sorts[k] = "double" if place < double_hits else "overload"
    return [sorts[k : k + hits] for k in range(0, total, hits)]


def _starts(
    point: str, hits: int, pretrigger_s: float, record_s: float, pulse_s: float, seed: int, *, apart: bool
) -> Array:
    """When the hits on a point begin, in the time of their records: neither on a sample nor by the clock."""
    late = np.random.default_rng([seed, hits, *point.encode()]).uniform(size=hits)
    if apart:
        return np.asarray(pretrigger_s + pulse_s * late)
    return np.asarray(pretrigger_s + record_s * (np.arange(hits) + LATE * late))


def _rehearsal(
    robot: Robot, posture: Posture, own: Modes, points: tuple[str, ...], sensors: tuple[str, ...], hammer: Hammer,
    record_s: float,
) -> tuple[dict[str, float], float]:  # fmt: skip
    """How far a mean hit moves each coordinate of the linear robot at most, and its largest acceleration."""
    slowest = float(own.natural_freq_hz[own.oscillatory].min(initial=math.inf))
    duration_s = min(record_s, hammer.pulse_s + REHEARSED_PERIODS / slowest)
    rate = max(20 / hammer.pulse_s, 4 * float(own.natural_freq_hz.max()) if slowest < math.inf else 0.0)
    rate = min(rate, 1e5 / duration_s)
    swing: dict[str, float] = {}
    largest = 0.0
    for point in points:
        pulses = mean_blow(point, hammer, 0.0).pulses()
        frames = list(by_place(sensors))
        moved = linear_response(robot, posture, pulses, duration_s=duration_s, sample_rate_hz=rate, frames=frames)
        for channel, values in zip(moved.channels, moved.values.T, strict=True):
            if channel.quantity == "joint_position":
                far = float(np.abs(values - values[0]).max())
                swing[channel.name] = max(far, swing.get(channel.name, 0.0))
        largest = max(largest, float(np.abs(moved.select("acceleration").values).max()))
    return swing, largest


def _labels(robot: Robot, where: str, given: str | Sequence[str] | None) -> tuple[str, ...]:
    if given is None:
        return tuple(f"{only_frame(robot, where)}.{axis}" for axis in AXES)
    labels = (given,) if isinstance(given, str) else tuple(given)
    expected = "PLACE.AXIS with a frame of the robot and x, y or z, such as sensor.x"
    if not labels:
        raise SimulationError(where, found="none", expected=expected)
    for label in labels:
        try:
            place, axis = split_label(label)
            robot.frame_index(place)
        except ArmonicError as error:
            raise SimulationError(where, found=repr(label), expected=expected, hint=error.hint) from error
        if axis not in AXES:
            raise SimulationError(where, found=repr(label), expected=expected)
        if labels.count(label) > 1:
            raise SimulationError(where, found=f"{label} twice", expected="each degree of freedom once")
    return labels
