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
    """Ten postures, 150 lines, 18 parameters; and how the cost of an evaluation grows with postures and lines."""
    truth, start = am.load("kuka_kr90"), kuka_start()
    rng = np.random.default_rng(10)
    postures = [[0.0, 1.2, -1.7], *rng.uniform([-1, 0.3, -2.2], [1, 1.5, -0.6], (9, 3)).tolist()]

    def fit(count: int, lines: int) -> am.Fit:
        freq_hz = np.linspace(0.2, 30, lines)
        data = [am.Measurement(am.frf(truth, q, freq_hz, frame="sensor"), q) for q in postures[:count]]
        return am.update(start, data)

    times = [np.median([fit(10, 150).duration_s for _ in range(rounds)])]
    print(f"ten postures, 150 lines, 18 parameters: median of {rounds} {times[0]:.3f} s, cost {fit(10, 150).cost:.0e}")
    each = {
        size: np.median([(f := fit(*size)).duration_s / f.evaluations for _ in range(rounds)])
        for size in ((1, 150), (2, 150), (5, 150), (10, 150), (10, 300), (10, 600))
    }
    for (count, lines), seconds in each.items():
        print(
            f"{count:3d} postures {lines:4d} lines {seconds * 1e3:8.3f} ms an evaluation, "
            f"{seconds / (count * lines) * 1e6:6.3f} µs a line"
        )


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


if __name__ == "__main__":
    main()
