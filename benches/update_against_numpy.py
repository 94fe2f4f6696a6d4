"""The KUKA fit by `am.update` against the same SciPy solver fed by a NumPy residual and analytic Jacobian.

Both start from Table 4 of Huynh et al. 2021, under the same bounds, weights and tolerances and in the same two passes,
and take turns in this process. NumPy has one thread, its fastest at this size. The run of the solver is compared with
the like; the whole call has linear models, modes, intervals and the updated file in it too.

    python benches/update_against_numpy.py [rounds]
"""

from __future__ import annotations

import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[variable] = "1"  # before NumPy loads its threads

import sys

import numpy as np
from scipy.optimize import least_squares

import armonic as am
from armonic.updating.measurement import levelled
from armonic.updating.solver import FIRST_TOLERANCE
from solver_alone import LIMIT, TOLERANCE, Solver, kuka_start
from timing import interleaved

LINES_HZ = np.arange(1, 151) / 5


class NumpyFit:
    """Σ W |ln H_s − ln H|² of one full response matrix, vectorised over the lines."""

    def __init__(self, robot: am.Robot, data: am.Measurement) -> None:
        model = am.linearize(robot, data.posture)
        self.J = np.ascontiguousarray(model.jacobian(data.frame)[:3])
        s = 2j * np.pi * data.frf.freq_hz
        self.s = s
        self.rigid = s[:, None, None] ** 2 * model.mass + s[:, None, None] * model.free_damping + model.free_stiffness
        self.diagonal = np.argmax(model.directions, axis=1)  # each spring sits on one coordinate
        self.inverse = s[:, None, None] ** 2 / data.frf.values
        weights = data.line_weights()
        self.roots = {"levelled": np.sqrt(levelled(weights)), "weights": np.sqrt(weights)}
        paths = list(robot.parameters())
        self.index = [
            model.impedances.index(path.rpartition(".")[0]) + len(model.spring) * path.endswith("damping")
            for path in paths
        ]
        self.start = np.log(list(robot.parameters().values()))
        self.bounds = np.log([robot.bounds(path) for path in paths]).T
        self.evaluations = 0

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
        for name, tolerance in (("levelled", FIRST_TOLERANCE), ("weights", TOLERANCE)):
            solution = least_squares(
                self.residual,
                x,
                jac=self.jacobian,
                bounds=self.bounds,
                args=(self.roots[name],),
                xtol=tolerance,
                ftol=tolerance,
                gtol=tolerance,
                max_nfev=LIMIT,
            )
            x = solution.x
        return 2 * float(solution.cost)


def main() -> None:
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 25
    start = kuka_start()
    data = am.Measurement(am.frf(am.load("kuka_kr90"), "milling", LINES_HZ, frame="sensor"), "milling")
    peer, solver = NumpyFit(start, data), Solver(start, data)

    def whole() -> am.Fit:
        return am.update(start, data, tolerance=TOLERANCE, max_evaluations=LIMIT)

    run, fit = solver.run(), whole()
    ends = [(peer.run(), peer.evaluations), (run.cost, len(run.history)), (fit.cost, fit.evaluations)]
    times = interleaved(peer.run, solver.run, whole, rounds=rounds)
    print(f"KUKA KR90 from Table 4, noise-free, {len(LINES_HZ)} lines, 3x3 responses, 18 parameters")
    print(f"medians of {rounds}: time, evaluations, time of each, final cost, NumPy's time over it")
    names = ("SciPy fed by NumPy", "SciPy fed by Armonic", "am.update, whole call")
    for name, seconds, (cost, evaluations) in zip(names, times, ends, strict=True):
        each = seconds / evaluations * 1e3
        print(f"{name:22s} {seconds:8.4f} s {evaluations:5d} {each:7.3f} ms {cost:9.0e} {times[0] / seconds:6.1f}")


if __name__ == "__main__":
    main()
