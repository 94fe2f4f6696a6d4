"""A run in time: the nonlinear closed loop from a posture under excitations, sampled as labelled time series."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal, TypeAlias, TypedDict, get_args

import numpy as np

from armonic.errors import PostureError, SimulationError
from armonic.linear import linearize
from armonic.loads import WrenchAxes, load_of
from armonic.series import ENDED
from armonic.simulation.assembly import Assembly, assemble, rest_state, set_in_motion
from armonic.simulation.control import SampledControl
from armonic.simulation.excitations import MAX_SAMPLES, BandNoise, Excitation
from armonic.simulation.implicit import run_implicit
from armonic.simulation.signals import signals
from armonic.simulation.stability_region import longest_stable_step

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from armonic.linear import Equilibrium, Posture
    from armonic.robot import Robot
    from armonic.series import TimeSeries
    from armonic.simulation.joints import JointLaw

    Array: TypeAlias = NDArray[np.float64]

Method = Literal["auto", "explicit", "implicit"]
"""Dormand and Prince of order 8, Radau IIA of order 5, or the one that should be done first."""

IMPLICIT_PAYS = 1e6
"""Rate of the fastest motion, rad/s, beyond which Radau's long steps are cheaper than stability of explicit ones."""
POSITION_SCALE, VELOCITY_SCALE = 1e-6, 1e-4
"""Amplitudes (rad or m, per second) below which a relative tolerance turns into an absolute one."""
POSITION_ROUNDING, VELOCITY_ROUNDING = 1e-16, 1e-13
"""Deviations (rad or m, per second) are not known better: forces of gravity lose as much to rounding."""
STEPS_SHARE = 0.1
"""Steps are ten times as good as asked, so that what is interpolated between them keeps the tolerance too."""


class Asked(TypedDict):
    """What both kinds of steps are asked."""

    step: float
    samples: int
    relative: float
    absolute: Array
    progress: Callable[[float], object] | None


@dataclass(frozen=True, eq=False, repr=False)
class Run:
    """What a robot did, sampled evenly.

    Attributes:
        robot: the robot.
        posture: what its posture is called.
        series: every channel: positions, velocities, accelerations, torques, motion of frames, forces, energy.
        status: "complete", or "interrupted" after Ctrl-C; then the series ends early.
        method: "explicit" or "implicit" steps.
        steps: taken.
        rejected: of these, taken back.
        evaluations: of the equations of motion.
        seconds: how long it took.
    """

    robot: Robot = field(repr=False)
    posture: str
    series: TimeSeries
    status: Literal["complete", "interrupted"]
    method: Literal["explicit", "implicit"]
    steps: int
    rejected: int
    evaluations: int
    seconds: float

    def __repr__(self) -> str:
        """What was run and how much it took, in one line."""
        return (
            f"Run({self.robot.name}, posture {self.posture}: {len(self.series)} samples at "
            f"{self.series.sample_rate_hz:g} Hz, {self.steps} {self.method} steps, {self.status})"
        )

    def __getitem__(self, pattern: str) -> Array:
        """(samples,) of one channel: "motor_position:link_2.motor"."""
        return self.series[pattern]

    def energy_error(self) -> Array:
        """What the energy balance does not account for, J, (samples,).

        Kinetic and potential energy against their values at the start, the work of excitations and motors, and what
        was dissipated; zero but for the error of integration.
        """
        kinetic, potential, given, driven, lost = self.series.select("energy").values.T
        held = kinetic + potential
        return np.asarray(held - held[0] - given - driven + lost, np.float64)


def simulate(
    robot: Robot,
    posture: Posture,
    excitations: Excitation | Sequence[Excitation] = (),
    *,
    duration_s: float,
    sample_rate_hz: float = 1000.0,
    control: SampledControl | None = None,
    joints: JointLaw | Sequence[JointLaw] = (),
    frames: Sequence[str] | None = None,
    displacement: Mapping[str, float] | None = None,
    velocity: Mapping[str, float] | None = None,
    wrench: ArrayLike | None = None,
    frame: str | None = None,
    wrench_axes: WrenchAxes = "world",
    equilibrium: Equilibrium = "reference",
    tolerance: float = 1e-10,
    method: Method = "auto",
    progress: Callable[[float], object] | None = None,
) -> Run:
    """Integrates the full nonlinear closed loop of a robot (Do et al. 2022, Eqs. 1 to 4) from a posture.

    Links, motors, shafts, bushings, drives, control, gravity, a constant wrench and excitations; adaptive steps with
    dense output at the sampling instants, which begin anew where an excitation or a sampled control jumps.

    Args:
        robot: the robot.
        posture: the desired state; where the run begins unless it is displaced.
        excitations: what acts on the robot.
        duration_s: length of the run; the last sample is not after it.
        sample_rate_hz: samples per second.
        control: a computer that runs the control law; by default it acts continuously.
        joints: hardening, backlash, friction.
        frames: whose motion is wanted; by default the frames that the robot file defines.
        displacement: by coordinate or motor, rad or m, added to the start.
        velocity: by coordinate or motor, rad/s or m/s, at the start.
        wrench: constant, as in `linearize`; the feed-forward knows it.
        frame: where the wrench acts.
        wrench_axes: as in `linearize`.
        equilibrium: "reference": coordinates on springs carry gravity and wrench of the posture, so that they rest
            there; drives hold what their control holds. "static": the run begins where everything balances.
        tolerance: relative error of positions and velocities; the absolute one follows from amplitudes of 1 µm or µrad.
        method: the steps.
        progress: called now and then with the time that was reached, s; what it raises ends the run.

    Returns:
        The run. Ctrl-C ends it early, with what was computed until then.

    Raises:
        PostureError: posture, frame or wrench do not fit the robot.
        SimulationError: an argument does not make sense; or the run left all bounds: the error's `run` then holds what
            was computed before.
        ModelError: no static equilibrium, or a coordinate that moves no mass.
    """
    acting = acting_of(excitations)
    samples, step = samples_of(duration_s, sample_rate_hz)
    _refuse_odd(tolerance, method, equilibrium)
    load = load_of(robot, wrench, frame, wrench_axes)
    watched = frames_of(robot, frames)
    assembly = assemble(
        robot,
        posture,
        load,
        excitations=acting,
        joints=joints if isinstance(joints, Iterable) else (joints,),
        duration_s=(samples - 1) * step,
        preloaded=equilibrium == "reference",
    )
    at_rest = rest_state(assembly, load, equilibrium)
    start = set_in_motion(at_rest, assembly.names, displacement, velocity)
    sampled = _sampled(assembly, control, (samples - 1) * step, at_rest)
    chosen, longest = _steps(assembly, method, sampled is not None)
    asked: Asked = {
        "step": step,
        "samples": samples,
        "relative": STEPS_SHARE * tolerance,
        "absolute": _absolute(assembly, STEPS_SHARE * tolerance),
        "progress": progress,
    }
    began = time.perf_counter()
    try:
        rows, ending, at, body, steps, rejected, evaluations = (
            run_implicit(assembly.plant, start, bodies=assembly.bodies, **asked)
            if chosen == "implicit"
            else assembly.plant.run(start, longest=longest, sampled=sampled, **asked)
        )
    except ArithmeticError as error:
        if "mass matrix" not in str(error):  # of a listener
            raise
        raise SimulationError(
            f"{robot.name}, posture {assembly.label}",
            found="a mass matrix that is not positive definite",
            expected="mass behind every coordinate that moves",
            hint="Run `armonic check` on the robot file.",
        ) from error
    series = signals(assembly, rows, sample_rate_hz, watched)
    if ending != "complete":
        series = replace(series, notes={**series.notes, ENDED: f"{ending} at {at:.6g} s"})
    run = Run(
        robot=robot,
        posture=assembly.label,
        series=series,
        status="interrupted" if ending == "interrupted" else "complete",
        method=chosen,
        steps=steps,
        rejected=rejected,
        evaluations=evaluations,
        seconds=time.perf_counter() - began,
    )
    if ending in ("diverged", "stalled"):
        raise _ended(assembly, run, ending, at, body)
    return run


def _ended(assembly: Assembly, run: Run, ending: str, at: float, body: int) -> SimulationError:
    if ending == "diverged":
        found = f"{assembly.names[body]} beyond all bounds at {at:.6g} s"
        hint = "The loop is unstable, or a force is too large: look at `armonic modes`, gains, rate and delay."
    else:
        found = f"steps too short to go on at {at:.6g} s"
        hint = "Something moves too fast for this tolerance: look at masses, stiffness, gains and joint laws."
    where = f"{assembly.robot.name}, posture {assembly.label}"
    error = SimulationError(where, found=found, expected="a bounded motion", hint=hint)
    error.run = run
    return error


def acting_of(given: Excitation | Sequence[Excitation]) -> tuple[Excitation, ...]:
    """Excitations as a tuple; a SimulationError if one is something else."""
    acting = tuple(given) if isinstance(given, Iterable) else (given,)
    for one in acting:
        if not isinstance(one, Excitation):
            expected = "Impulse, HammerPulse, Step, Sine, Sweep, BandNoise or MeasuredForce"
            raise SimulationError("excitations", found=repr(one), expected=expected)
    return tuple(
        replace(one, seed=place) if isinstance(one, BandNoise) and one.seed is None else one
        for place, one in enumerate(acting)
    )


def samples_of(duration_s: float, sample_rate_hz: float) -> tuple[int, float]:
    """Number of samples and the time between them."""
    for name, value in (("duration_s", duration_s), ("sample_rate_hz", sample_rate_hz)):
        if not (isinstance(value, int | float | np.number) and math.isfinite(value) and value > 0):
            raise SimulationError(name, found=repr(value), expected="a finite number above 0")
    length = duration_s * sample_rate_hz * (1 + 1e-12)
    if not 1 <= length < MAX_SAMPLES:
        count = str(math.floor(length) + 1) if length < 1e15 else f"{length:.3g}"
        raise SimulationError(
            "duration_s",
            found=f"{duration_s:g} s at {sample_rate_hz:g} Hz, {count} samples",
            expected=f"2 to {MAX_SAMPLES} samples",
        )
    return math.floor(length) + 1, 1 / sample_rate_hz


def _refuse_odd(tolerance: float, method: str, equilibrium: str) -> None:
    if not (isinstance(tolerance, int | float | np.number) and 1e-14 <= tolerance <= 1e-2):
        raise SimulationError("tolerance", found=repr(tolerance), expected="a number from 1e-14 to 0.01")
    if method not in get_args(Method):
        raise SimulationError("method", found=repr(method), expected=f"one of {', '.join(get_args(Method))}")
    if equilibrium not in ("reference", "static"):
        raise PostureError("equilibrium", found=repr(equilibrium), expected='"reference" or "static"')


def frames_of(robot: Robot, frames: Sequence[str] | None) -> tuple[str, ...]:
    """Names of the frames to watch, each once: by default those of the robot file."""
    if frames is None:
        return tuple(entry.name for entry in robot.description.frames)
    names = (frames,) if isinstance(frames, str) else tuple(frames)
    for name in names:
        robot.frame_index(name)
    return tuple(dict.fromkeys(names))


def _steps(assembly: Assembly, method: Method, sampled: bool) -> tuple[Literal["explicit", "implicit"], float]:
    """Which steps to take, and the longest that is worth trying if they are explicit, s."""
    if sampled and method == "implicit":
        raise SimulationError(
            "method",
            found='"implicit" with sampled control',
            expected='"explicit" or "auto"',
            hint="A computer acts so often that long steps do not pay.",
        )
    matrix = linearize(assembly.robot, assembly.q).state_matrix()
    poles = np.asarray(np.linalg.eigvals(matrix), np.complex128)
    stiff = float(np.abs(poles).max()) > IMPLICIT_PAYS and not sampled
    if method == "implicit" or (method == "auto" and stiff):
        return "implicit", math.inf
    return "explicit", longest_stable_step(poles)


def _absolute(assembly: Assembly, tolerance: float) -> Array:
    """Absolute tolerances of all states; works only follow."""
    z, states = assembly.bodies, assembly.plant.states
    integrators = states - 2 * z - 3
    parts = [
        (z, max(tolerance * POSITION_SCALE, POSITION_ROUNDING)),
        (z, max(tolerance * VELOCITY_SCALE, VELOCITY_ROUNDING)),
        (integrators, tolerance),
        (3, 1e300),
    ]
    return np.concatenate([np.full(count, value) for count, value in parts])


def _sampled(
    assembly: Assembly, control: SampledControl | None, duration_s: float, at_rest: Array
) -> tuple[float, float, bool, list[float], list[float], list[float]] | None:
    if control is None:
        return None
    if not isinstance(control, SampledControl):
        raise SimulationError("control", found=repr(control), expected="a SampledControl, or None")
    if not len(assembly.loop):
        raise SimulationError("control", found="a robot without motors", expected="a robot with drives")
    if control.rate_hz * duration_s > MAX_SAMPLES:
        found, expected = f"{control.rate_hz:g} Hz for {duration_s:g} s", f"at most {MAX_SAMPLES} instants of control"
        raise SimulationError("SampledControl.rate_hz", found=found, expected=expected)
    reference = assembly.rest.motor_position.tolist()
    difference = control.velocity == "difference"
    steps = (control.encoder_step / assembly.robot.drives.gear_ratio).tolist()
    z, loop = assembly.bodies, assembly.loop
    held = assembly.rest.motor_torque - loop.position @ at_rest[:z]
    held[loop.integrating] -= at_rest[2 * z : 2 * z + len(loop.integrating)]
    return 1 / control.rate_hz, control.delay_s, difference, steps, reference, held.tolist()
