"""Modal analysis: complex modes of a linear model, how they compare, and whether they are stable."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from armonic.errors import FrfError, ModelError
from armonic.linear import Equilibrium, LinearModel, model_of
from armonic.loads import WrenchAxes

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from armonic.linear import Posture
    from armonic.robot import Robot

    Array: TypeAlias = NDArray[np.float64]
    Complex: TypeAlias = NDArray[np.complex128]

Stability = Literal["asymptotically stable", "marginal", "unstable"]

FASTEST = 1e30
"""Rates beyond this are mistakes in the robot file, and their squares would overflow."""
STABILITY_TOLERANCE = 1e-9
"""Real parts below this share of the largest pole count as zero: eigenvalues are not known better."""


@dataclass(frozen=True, eq=False, repr=False)
class Modes:
    """Complex modes of λ² M u + λ C u + K u + G u/λ = 0, sorted by natural frequency; G is zero without integral gain.

    Oscillatory modes stand for a conjugate pair (Im λ > 0); real poles are kept, one entry each.

    Attributes:
        posture: name of the posture, or its numbers.
        coordinates: names of the n coordinates: those of the links, then the motors.
        poles: λ, (m,), rad/s.
        natural_freq_hz: |λ| / 2π, (m,), the undamped frequency (Do et al. 2022, Eq. 16).
        damped_freq_hz: Im λ / 2π, (m,), the one Huynh et al. 2021 print (Eq. 20).
        damping_ratio: −Re λ / |λ|, (m,), a fraction; zero for a rigid-body mode.
        oscillatory: whether the mode is one of a pair, (m,).
        mass: M at that posture, (n, n), kg m² or kg.
        shapes: u by columns, (n, m), rad or m, scaled to uᴴ M u = 1 with uᵀ M u real and positive, which for
            proportional damping are the real mass-normalized shapes; the largest entry has a positive real part.
        participation: share of each coordinate's spring in the elastic energy of a mode, (n, m). The spring of a driven
            coordinate is its shaft in series with the control's, k |w q − q_m|² + k_p |q_m|²; rows of motors are zero.
            Together with `bushing_participation` a column adds up to one; both are zero for a rigid-body mode. Where
            springs alone hold the robot (no drive, gravity or wrench) and damping is small, it is also 2 ∂ln f / ∂ln k.
        bushings: names of the b directions in which bushings act: "mount.x", "mount.rx".
        bushing_participation: share of the spring in each of them (of the diagonal stiffness), (b, m).
        stability: "asymptotically stable", "unstable" or "marginal", the three cases of Do et al. 2022, section 3.2.
    """

    posture: str
    coordinates: tuple[str, ...]
    poles: Complex
    natural_freq_hz: Array
    damped_freq_hz: Array
    damping_ratio: Array
    oscillatory: NDArray[np.bool_]
    mass: Array
    shapes: Complex
    participation: Array
    bushings: tuple[str, ...]
    bushing_participation: Array
    stability: Stability

    def __repr__(self) -> str:
        """How many, where, and whether stable, in one line."""
        band = f"{self.natural_freq_hz.min():.4g} to {self.natural_freq_hz.max():.4g} Hz"
        return f"Modes({len(self)} modes from {band}, posture {self.posture}, {self.stability})"

    def __len__(self) -> int:
        """Number of modes."""
        return len(self.poles)

    def movers(self, mode: int, *, count: int = 3, least: float = 0.05) -> tuple[tuple[str, float], ...]:
        """Coordinates and bushings that store most of a mode's elastic energy, with their shares.

        Args:
            mode: index of the mode.
            count: at most so many.
            least: smaller shares are left out.
        """
        names = self.coordinates + self.bushings
        share = np.concatenate([self.participation[:, mode], self.bushing_participation[:, mode]])
        order = np.argsort(-share)[:count]
        return tuple((names[i], float(share[i])) for i in order if share[i] >= least)


def modes(
    robot: Robot | LinearModel,
    posture: Posture | None = None,
    *,
    wrench: ArrayLike | None = None,
    frame: str | None = None,
    wrench_axes: WrenchAxes = "world",
    equilibrium: Equilibrium = "reference",
) -> Modes:
    """Natural frequencies, damping and complex shapes at a posture, by LAPACK.

    Of a robot on drives they are those of the closed loop (Do et al. 2022, Eqs. 13 to 18), poles of integrators
    included; a loop that is unstable is said to be so.

    Args:
        robot: a robot, or a linear model that is taken as it is.
        posture: with a robot, a posture's name or joint coordinates; if not given, its only named posture, or all
            coordinates zero if it names none.
        wrench: as in `linearize`.
        frame: as in `linearize`.
        wrench_axes: as in `linearize`.
        equilibrium: as in `linearize`.

    Raises:
        PostureError: posture, wrench or frame do not fit the robot, or come with a linear model.
        ModelError: no positive definite mass matrix, no equilibrium, or every coordinate locked.
    """
    model = model_of(robot, posture, wrench=wrench, frame=frame, wrench_axes=wrench_axes, equilibrium=equilibrium)
    n = len(model.coordinates)
    # Mass-normalized coordinates y = Lᵀ u, and time in units of the fastest motion, keep the matrix balanced.
    left = np.asarray(np.linalg.inv(model.mass_factor), np.float64)
    stiffness, damping = left @ model.stiffness @ left.T, left @ model.damping @ left.T
    rate = max(float(np.sqrt(np.linalg.norm(stiffness, 2))), float(np.linalg.norm(damping, 2))) or 1.0
    if not rate < FASTEST:
        raise ModelError(
            f"{model.robot.name}, posture {model.posture}",
            found=f"a rate of {rate:.3g} rad/s",
            expected=f"poles below {FASTEST:g} rad/s",
            hint="Check masses, inertia, stiffness and damping: some are many orders off.",
        )
    # Rounding errors of the mass-normalized stiffness, and of squares of its eigenvalues, stay below this.
    terms = float(np.linalg.norm(abs(left) @ abs(model.stiffness) @ abs(left.T), 2))
    noise = 16 * n * float(np.finfo(float).eps) * (rate**2 + terms)
    state = np.block([[np.zeros((n, n)), np.eye(n)], [-stiffness / rate**2, -damping / rate]])
    integral = left @ model.integral @ left.T
    state = _with_integrators(state, model.links + model.loop.integrating, integral / rate**3)
    eigenvalues, vectors = np.linalg.eig(state)
    values, y = rate * eigenvalues.astype(np.complex128), vectors[:n].astype(np.complex128)
    values[_rigid(values, y, damping, integral, noise)] = 0.0
    keep = np.flatnonzero(values.imag >= 0)
    keep = keep[np.lexsort((values[keep].imag, np.abs(values[keep])))]
    poles = values[keep]
    shapes = _normalized(y[:, keep], left)
    size = np.abs(poles)
    own, of_bushings = _energy_shares(model, shapes, noise)
    worst = float(values.real.max())
    tolerance = STABILITY_TOLERANCE * float(np.abs(values).max())
    return Modes(
        posture=model.posture,
        coordinates=model.coordinates,
        poles=poles,
        natural_freq_hz=size / (2 * np.pi),
        damped_freq_hz=poles.imag / (2 * np.pi),
        damping_ratio=np.divide(-poles.real, size, out=np.zeros(len(poles)), where=size > 0),
        oscillatory=poles.imag > 0,
        mass=model.mass,
        shapes=shapes,
        participation=own,
        bushings=tuple(name.removeprefix("bushings.") for name in model.impedances if name.startswith("bushings.")),
        bushing_participation=of_bushings,
        stability="unstable" if worst > tolerance else "marginal" if worst >= -tolerance else "asymptotically stable",
    )


def _with_integrators(state: Array, rows: NDArray[np.intp], integral: Array) -> Array:
    """A state matrix with one integrator more for each of the rows of G that are not zero."""
    if not len(rows):
        return state
    n, p = len(integral), len(rows)
    whole = np.zeros((2 * n + p, 2 * n + p))
    whole[: 2 * n, : 2 * n] = state
    whole[n + rows, 2 * n + np.arange(p)] = -1.0
    whole[2 * n :, :n] = integral[rows]
    return whole


def _energy_shares(model: LinearModel, shapes: Complex, noise: float) -> tuple[Array, Array]:
    """Shares of the coordinates' springs, (n, m), and of the bushings, (b, m), in the elastic energy of every mode."""
    own = np.zeros((len(model.coordinates), shapes.shape[1]))
    others = [np.zeros((0, shapes.shape[1]))]
    for name, direction, spring in zip(model.impedances, model.directions, model.spring, strict=True):
        stored = spring * np.abs(direction @ shapes) ** 2
        if name.startswith("bushings."):
            others.append(stored[None])
        else:
            own[np.argmax(direction)] += stored
    loop, drives = model.loop, model.drives
    turns, motors = drives.scale[:, None] * shapes[loop.driven], shapes[loop.motors]
    shafts, control = drives.shaft_stiffness[:, None], model.control.kp[:, None]
    own[loop.driven] += shafts * np.abs(turns - motors) ** 2 + control * np.abs(motors) ** 2
    of_bushings = np.vstack(others)
    total = own.sum(axis=0) + of_bushings.sum(axis=0)
    total = np.where(total > noise, total, np.inf)
    return own / total, of_bushings / total


def _rigid(poles: Complex, shapes: Complex, damping: Array, integral: Array, noise: float) -> NDArray[np.bool_]:
    """Which poles are those of a rigid body: λ² + λ yᴴCy + yᴴGy/λ, which is −yᴴKy, is no more than noise."""
    y = shapes / np.linalg.norm(shapes, axis=0)
    dissipated, integrated = (np.abs(np.sum(y.conj() * (matrix @ y), axis=0)) for matrix in (damping, integral))
    size = np.abs(poles)
    held = np.divide(integrated, size, out=np.zeros(len(poles)), where=size > 0)
    return np.asarray(size**2 + size * dissipated + held <= noise)


def _normalized(mass_normal: Complex, left: Array) -> Complex:
    """Shapes u = L⁻ᵀ y with yᴴ y = 1, yᵀ y real and positive, largest entry of u towards positive reals."""
    y = mass_normal / np.linalg.norm(mass_normal, axis=0)
    y = y * np.exp(-0.5j * np.angle(np.sum(y * y, axis=0)))
    u = left.T @ y
    largest = np.take_along_axis(u, np.argmax(np.abs(u), axis=0)[None], axis=0)
    return np.asarray(u * np.where(largest.real < 0, -1.0, 1.0))


def mac(a: Modes | Complex, b: Modes | Complex) -> Array:
    """Modal assurance criterion of every pair of shapes, (m_a, m_b), between 0 and 1.

    |aᴴ b|² / (aᴴ a · bᴴ b) for shapes over sensors. Shapes of `Modes` mix radians and metres, so there the products are
    weighted by the mass matrix of `a`, aᴴ M b, which has one unit and sets undamped modes apart exactly.

    Args:
        a: modes, or shapes by columns (n, m_a).
        b: modes, or shapes by columns (n, m_b), over the same n coordinates or sensors.

    Raises:
        FrfError: modes are compared with bare shapes, lengths differ, or a shape is zero.
    """
    if isinstance(a, Modes) != isinstance(b, Modes):
        raise FrfError("mac", found="modes and bare shapes", expected="two of a kind; take `.shapes` of the modes")
    left, right = (np.asarray(x.shapes if isinstance(x, Modes) else x) for x in (a, b))
    if left.ndim != 2 or right.ndim != 2 or left.shape[0] != right.shape[0]:
        raise FrfError(
            "mac",
            found=f"shapes {left.shape} and {right.shape}",
            expected="columns of one length, (n, m_a) and (n, m_b)",
        )
    if isinstance(a, Modes):
        factor = np.linalg.cholesky(a.mass).T
        left, right = factor @ left, factor @ right
    norms = [np.sum(np.abs(x) ** 2, axis=0) for x in (left, right)]
    if not all(np.isfinite(norm).all() and (norm > 0).all() for norm in norms):
        raise FrfError("mac", found="a shape that is zero or not finite", expected="finite shapes other than zero")
    return np.asarray(np.abs(left.conj().T @ right) ** 2 / np.outer(*norms), np.float64)
