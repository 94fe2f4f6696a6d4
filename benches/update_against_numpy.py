"""The KUKA fit by `am.update` against the same ladder in NumPy and SciPy.

Both start from Table 4 of Huynh et al. 2021 and go down the same rungs, levelled stage and cost, under the same bounds,
weights, tolerances and limits on evaluations, and take turns in this process. The peer has a residual and an analytic
Jacobian vectorized over the lines, SciPy's bounded trust region, and Poisson's integral as a matrix product; NumPy has
one thread, its fastest at this size. The whole call of `am.update` has models, modes, intervals and verdicts in it too.

    python benches/update_against_numpy.py [rounds]
"""

from __future__ import annotations

import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "RAYON_NUM_THREADS"):
    os.environ[variable] = "1"  # before NumPy loads its threads

import sys
from importlib.resources import files

import numpy as np
from scipy.optimize import least_squares

import armonic as am
from armonic.updating.measurement import levelled
from armonic.updating.smoothing import ladder, smoothed
from armonic.updating.stages import LEVELLED_TOLERANCE, RUNG_EVALUATIONS, RUNG_TOLERANCE
from timing import interleaved

LINES_HZ = np.arange(1, 151) / 5
TOLERANCE = 1e-10


class NumpyLadder:
    """Σ W |ln H_s − ln H|² of one full response matrix, at s = σ + iω and down to σ = 0."""

    def __init__(self, robot: am.Robot, data: am.Measurement) -> None:
        model = am.linearize(robot, data.posture)
        self.model, self.frf = model, data.frf
        self.J = np.ascontiguousarray(model.jacobian(data.frame)[:3])
        self.diagonal = np.argmax(model.directions, axis=1)  # each spring sits on one coordinate
        self.weights = data.line_weights()
        paths = list(robot.parameters())
        self.index = [
            model.impedances.index(path.rpartition(".")[0]) + len(model.spring) * path.endswith("damping")
            for path in paths
        ]
        self.start = np.log(list(robot.parameters().values()))
        self.bounds = np.log(
            [robot.bounds(path) or (value / 1e3, value * 1e3) for path, value in robot.parameters().items()]
        ).T
        self.evaluations = 0

    def at(self, sigma: float) -> None:
        """Prepares the lines at σ + iω."""
        axis = 2j * np.pi * self.frf.freq_hz[:, None, None]
        mobility = self.frf.values / axis
        self.s = s = axis[:, 0, 0] + sigma
        if sigma:
            mobility = smoothed(self.frf.freq_hz, mobility, sigma)
        self.inverse = s[:, None, None] / mobility
        model = self.model
        self.rigid = s[:, None, None] ** 2 * model.mass + s[:, None, None] * model.free_damping + model.free_stiffness

    def residual(self, x: np.ndarray, root: np.ndarray) -> np.ndarray:
        self.evaluations += 1
        theta = np.empty(len(x))
        theta[self.index] = np.exp(x)
        self.spring, self.damper = theta.reshape(2, -1)
        Z = self.rigid.copy()
        Z[:, self.diagonal, self.diagonal] += self.spring + self.s[:, None] * self.damper
        self.X = np.linalg.solve(Z, np.broadcast_to(self.J.T, (len(Z), *self.J.T.shape)))
        self.H = self.J @ self.X
        logarithm = root * np.log(self.H * self.inverse)
        return logarithm.view(float).ravel()

    def jacobian(self, x: np.ndarray, root: np.ndarray) -> np.ndarray:
        """By the logarithms, at the point of the last residual; ∂H_ab/∂z_i = −X_ia X_ib."""
        Y = self.X[:, self.diagonal]
        by_impedance = np.einsum("lia,lib->labi", Y, Y) * (-root / self.H)[..., None]
        both = np.concatenate(
            [by_impedance * self.spring, by_impedance * (self.s[:, None] * self.damper)[:, None, None]], axis=-1
        )[..., self.index]
        rows = np.empty((*both.shape[:3], 2, both.shape[3]))
        rows[..., 0, :], rows[..., 1, :] = both.real, both.imag
        return rows.reshape(-1, len(x))

    def run(self) -> float:
        x, self.evaluations = self.start, 0
        even = np.sqrt(levelled(self.weights))
        stages = [(sigma, even, RUNG_TOLERANCE, RUNG_EVALUATIONS) for sigma in ladder(self.frf.freq_hz)]
        stages += [(0.0, even, LEVELLED_TOLERANCE, None), (0.0, np.sqrt(self.weights), TOLERANCE, None)]
        for sigma, root, tolerance, limit in stages:
            self.at(sigma)
            solution = least_squares(
                self.residual,
                x,
                jac=self.jacobian,
                bounds=self.bounds,
                args=(root,),
                xtol=tolerance,
                ftol=tolerance,
                gtol=tolerance,
                max_nfev=limit,
            )
            x = solution.x
        return 2 * float(solution.cost)


def compare(name: str, start: am.Robot, truth: am.Robot, rounds: int) -> None:
    """Prints medians of one case."""
    data = am.Measurement(am.frf(truth, "milling", LINES_HZ, frame="sensor"), "milling")
    peer = NumpyLadder(start, data)

    def whole() -> am.Fit:
        return am.update(start, data, tolerance=TOLERANCE)

    fit = whole()
    ends = [(peer.run(), peer.evaluations), (fit.cost, fit.evaluations)]
    times = interleaved(peer.run, whole, rounds=rounds)
    print(f"{name}, noise-free, {len(LINES_HZ)} lines, 3x3 responses, {len(fit.parameters)} parameters")
    print(f"medians of {rounds}: time, evaluations, time of each, final cost, the peer's time over it")
    for label, seconds, (cost, evaluations) in zip(
        ("NumPy and SciPy", "am.update, whole call"), times, ends, strict=True
    ):
        each = seconds / evaluations * 1e3
        print(f"{label:22s} {seconds:8.4f} s {evaluations:5d} {each:7.3f} ms {cost:9.0e} {times[0] / seconds:6.1f}")


def ten_postures(rounds: int) -> None:
    """Prints how long ten postures of 150 lines and 18 parameters take."""
    start, postures = kuka_start(), ten()
    data = [measured(am.load("kuka_kr90"), q, 150) for q in postures]
    fits = [am.update(start, data) for _ in range(rounds)]
    seconds = np.median([fit.duration_s for fit in fits])
    print(f"ten postures, 150 lines, 18 parameters: median of {rounds} {seconds:.3f} s, cost {fits[0].cost:.0e}")


def growth(rounds: int) -> None:
    """Prints the time of one evaluation, residual and Jacobian, over postures x lines x n²."""
    kuka = am.load("kuka_kr90")
    cases = [(kuka, ten()[:count], lines) for count, lines in ((1, 150), (10, 150), (1, 1500), (10, 1500))]
    cases += [(chain(n), [[0.3] * n], 300) for n in (3, 6, 12, 24)]
    print("one evaluation, residual and Jacobian by two parameters per coordinate, one thread")
    for robot, postures, lines in cases:
        fit = am.update(robot, [measured(robot, q, lines) for q in postures], max_evaluations=1)
        residual = fit.task.residual([m.line_weights() for m in fit.measurements])
        x, n = fit.task.start, len(robot.coordinates)
        (seconds,) = interleaved(lambda residual=residual, x=x: residual.triangle(x), rounds=rounds)
        size = len(postures) * lines * n**2
        print(
            f"{len(postures):3d} postures {lines:5d} lines, n = {n:2d}: {seconds * 1e3:8.3f} ms, "
            f"{seconds / size * 1e9:6.2f} ns over postures x lines x n²"
        )


def ten() -> list[list[float]]:
    """Postures about that of the paper."""
    spread = np.random.default_rng(10).uniform([-1, 0.3, -2.2], [1, 1.5, -0.6], (9, 3))
    return [[0.0, 1.2, -1.7], *spread.tolist()]


def measured(robot: am.Robot, posture: list[float], lines: int) -> am.Measurement:
    """Exact responses up to 30 Hz at the last frame."""
    H = am.frf(robot, posture, np.linspace(0.2, 30, lines), frame=robot.frames[-1])
    return am.Measurement(H, posture)


def chain(n: int) -> am.Robot:
    """A serial robot of n elastic joints about z, y and x in turn."""
    links = [
        f"  - {{name: l{i}, parent: {f'l{i - 1}' if i else 'base'}, placement: [{{x: 0.3, z: 0.1}}], "
        f"joint: {{type: revolute, axis: {'zyx'[i % 3]}}}, elasticity: {{{'zyx'[i % 3]}: {{stiffness: {1e6 / (i + 1)}, "
        f"damping: {200 / (i + 1)}}}}}, mass: {40 / (i + 1)}, com: [0.1, 0.05, 0.02], "
        f"inertia: {{xx: {2 / (i + 1)}, yy: {2 / (i + 1)}, zz: {2 / (i + 1)}}}}}"
        for i in range(n)
    ]
    return am.Robot.from_yaml("\n".join(["armonic: 1", f"name: chain of {n}", "links:", *links]))


def kuka_start() -> am.Robot:
    """The KUKA with the initial values and bounds of Table 4 of Huynh et al. 2021."""
    return am.load(str(files("armonic.examples") / "kuka_start.yaml"))


def main() -> None:
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 25
    compare("KUKA KR90 from Table 4", kuka_start(), am.load("kuka_kr90"), rounds)
    three = am.load("huynh_3r")
    off = three.with_values(
        {
            path: value * factor
            for (path, value), factor in zip(three.parameters().items(), (0.5, 2.0, 1.6, 0.6, 0.7, 1.8), strict=True)
        }
    )
    compare("3R example", off, three, rounds)
    ten_postures(max(rounds // 5, 3))
    growth(rounds)


if __name__ == "__main__":
    main()
