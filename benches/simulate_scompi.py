"""The hit on Scompi of Do et al. 2022 simulated for 3 s, against a loop over Pinocchio and SciPy's DOP853.

Both integrate the same equations by the same method from jump to jump of the force, with 3001 samples. All run in this
process, in turn; printed are medians, how much faster than real time they are, the ratio to the loop at the same
tolerance, and the largest error of a motor position against a run at 1e-13, over the amplitude. Armonic also records
torques, the motion of the tool, and energy.

    python benches/simulate_scompi.py [rounds]
"""

from __future__ import annotations

import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[variable] = "1"  # before NumPy loads its threads

import sys
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from scipy.integrate import solve_ivp

import armonic as am
from pinocchio_loop import pinocchio_model
from timing import busy_elsewhere, interleaved

DURATION = 3.0
HIT = am.Impulse(axis="y0", force=50.0, duration_s=0.006)
TOLERANCES = (1e-6, 1e-8, 1e-10)
SAME = 1e-5


class Loop:
    """Eqs. 1 to 4 as one writes them with Pinocchio; deviations are integrated, as in Armonic."""

    def __init__(self, robot: am.Robot) -> None:
        self.model = pinocchio_model(robot)
        self.data = self.model.createData()
        self.drives, self.control, self.q = robot.drives, robot.control, robot.posture("c8")
        self.feedforward = pin.computeGeneralizedGravity(self.model, self.data, self.q) / self.drives.scale
        self.last = self.model.njoints - 1
        pin.forwardKinematics(self.model, self.data, self.q)
        pose = pin.SE3(robot.mechanism.pose(self.q, robot.frame_index("tool")))
        self.tool = (self.data.oMi[self.last].inverse() * pose).translation
        self.evaluations = 0

    def rates(self, state: np.ndarray, force: float) -> np.ndarray:
        self.evaluations += 1
        d, c, q = self.drives, self.control, self.q + state[:6]
        twist = d.shaft_stiffness * (d.scale * state[:6] - state[6:12]) - self.feedforward
        torque = -d.scale * twist - d.joint_damping * state[12:18]
        if force:
            pin.computeJointJacobians(self.model, self.data, q)
            rows = pin.getJointJacobian(self.model, self.data, self.last, pin.LOCAL_WORLD_ALIGNED)
            push = np.array([0.0, force, 0.0])
            moment = np.cross(self.data.oMi[self.last].rotation @ self.tool, push)
            torque = torque + rows.T @ np.concatenate([push, moment])
        acceleration = pin.aba(self.model, self.data, q, state[12:18], torque)
        motor = self.feedforward - c.kp * state[6:12] - (c.kd + d.motor_damping) * state[18:]
        return np.concatenate([state[12:], acceleration, (twist + motor) / d.inertia])

    def run(self, tolerance: float) -> np.ndarray:
        """Deviations of the motors, (samples, 6)."""
        # As Armonic sets them from a tolerance: steps ten times as good, absolute from 1 µrad and 0.1 mrad/s.
        step = tolerance / 10
        absolute = np.repeat([max(step * 1e-6, 1e-16), max(step * 1e-4, 1e-13)], 12)
        time_s, state, rows = np.arange(3001) / 1000, np.zeros(24), []
        for begin, end, force in ((0.0, 0.2, 0.0), (0.2, 0.206, HIT.force), (0.206, DURATION, 0.0)):
            inside = time_s[(time_s > begin - 1e-9) & (time_s < end - 1e-9)]
            done = solve_ivp(
                lambda _, y, force=force: self.rates(y, force),
                (begin, end),
                state,
                method="DOP853",
                t_eval=np.append(inside, end),
                rtol=step,
                atol=absolute,
            )
            rows.extend(done.y.T[:-1])
            state = done.y[:, -1]
        return np.array([*rows, state])[:, 6:12]


@dataclass(frozen=True)
class Row:
    """One candidate: its name, seconds, evaluations of the equations of motion, and relative error."""

    name: str
    seconds: float
    evaluations: int
    error: float


def motors(series: am.TimeSeries) -> np.ndarray:
    values = series.select("motor_position").values
    return values - values[0]


def measure(rounds: int = 7) -> tuple[list[tuple[Row, Row]], list[Row], float]:
    """Armonic and the loop at each tolerance; what else there is; share of the processors busy elsewhere."""
    robot = am.load("scompi")
    loop = Loop(robot)

    def simulated(tolerance: float, **options: object) -> am.Run:
        return am.simulate(robot, "c8", HIT, duration_s=DURATION, tolerance=tolerance, **options)

    best = motors(simulated(1e-13).series)
    amplitude = np.abs(best).max()

    def error(found: np.ndarray) -> float:
        return float(np.abs(found - best).max() / amplitude)

    if not error(loop.run(1e-10)) < SAME:
        raise SystemExit("the two do not simulate the same robot")
    elsewhere = busy_elsewhere()
    pairs = []
    for tolerance in TOLERANCES:
        run = simulated(tolerance)
        loop.evaluations = 0
        theirs = error(loop.run(tolerance))
        evaluations = loop.evaluations
        ours, their_seconds = interleaved(
            lambda t=tolerance: simulated(t), lambda t=tolerance: loop.run(t), rounds=rounds
        )
        name = f"tolerance {tolerance:g}"
        mine = Row(name, ours, run.evaluations, error(motors(run.series)))
        pairs.append((mine, Row(name, their_seconds, evaluations, theirs)))
    computer = am.SampledControl(rate_hz=2000.0, delay_s=0.0005)
    others = [
        ("under a computer at 2 kHz", lambda: simulated(1e-8, control=computer)),
        ("linear response", lambda: am.linear_response(robot, "c8", HIT, duration_s=DURATION)),
    ]
    times = interleaved(*(call for _, call in others), rounds=rounds)
    rest = [Row(name, seconds, 0, float("nan")) for (name, _), seconds in zip(others, times, strict=True)]
    return pairs, rest, elsewhere


def main() -> None:
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 7
    pairs, rest, elsewhere = measure(rounds)
    print(f"Scompi at c8, 50 N for 6 ms, {DURATION:g} s at 1 kHz; medians of {rounds}")
    print(f"other programs kept {elsewhere:.0%} of the processors busy at the start")
    print(f"{'':28s} {'ms':>9s} {'× real time':>12s} {'evaluations':>12s} {'error':>9s} {'ratio':>7s}")

    def line(name: str, row: Row, ratio: float) -> None:
        count = f"{row.evaluations:12d}" if row.evaluations else " " * 12
        error = f"{row.error:9.1e}" if np.isfinite(row.error) else " " * 9
        of = f"{ratio:7.1f}" if np.isfinite(ratio) else ""
        print(f"{name:28s} {row.seconds * 1e3:9.1f} {DURATION / row.seconds:12.1f} {count} {error} {of}")

    for ours, theirs in pairs:
        line(f"Armonic, {ours.name}", ours, theirs.seconds / ours.seconds)
        line(f"loop, {theirs.name}", theirs, 1.0)
    for row in rest:
        line(f"Armonic, {row.name}", row, float("nan"))


if __name__ == "__main__":
    main()
