"""Compiled core of Armonic (Rust): the mechanism's algorithms, frequency responses, and the fitting residual.

Arguments are float64 or complex128 arrays. Arguments that do not fit raise ValueError; a computation without an answer
(singular mass matrix or dynamic stiffness) raises ArithmeticError. `Wrench` is a frame index with force over moment in
world axes.
"""

from collections.abc import Callable, Sequence
from typing import Literal, TypeAlias, final

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "Bushing",
    "LinearSystem",
    "Mechanism",
    "Plant",
    "Problem",
    "descend",
    "follow",
    "polynomial_backward_errors",
    "polynomial_eigenvalues",
    "polynomial_shapes",
    "responses",
]

_Real: TypeAlias = NDArray[np.float64]
_Complex: TypeAlias = NDArray[np.complex128]
_Wrench: TypeAlias = tuple[int, Sequence[float]]
_Wrenches: TypeAlias = Sequence[_Wrench] | None

@final
class Mechanism:
    def __new__(
        cls,
        *,
        parents: Sequence[int],
        placements: _Real,
        kinds: Sequence[str],
        axes: _Real,
        masses: _Real,
        coms: _Real,
        inertias: _Real,
        frame_nodes: Sequence[int],
        frame_placements: _Real,
        gravity: Sequence[float],
    ) -> Mechanism: ...
    @property
    def n(self) -> int: ...
    def pose(self, q: _Real, frame: int) -> _Real: ...
    def jacobian(self, q: _Real, frame: int, *, own_axes: bool = False) -> _Real: ...
    def frame_motion(self, q: _Real, qd: _Real, qdd: _Real, frame: int) -> _Real: ...
    def mass_matrix(self, q: _Real) -> _Real: ...
    def gravity_torque(self, q: _Real) -> _Real: ...
    def bias(self, q: _Real, qd: _Real) -> _Real: ...
    def inverse_dynamics(self, q: _Real, qd: _Real, qdd: _Real, *, wrenches: _Wrenches = None) -> _Real: ...
    def forward_dynamics(self, q: _Real, qd: _Real, tau: _Real, *, wrenches: _Wrenches = None) -> _Real: ...
    def at_rest(self, q: _Real, *, wrenches: _Wrenches = None) -> list[_Real]: ...
    def linearize(
        self,
        q: _Real,
        qd: _Real,
        qdd: _Real,
        *,
        wrenches: _Wrenches = None,
        bushings: Sequence[Bushing] | None = None,
    ) -> _Real: ...

@final
class Bushing:
    def __new__(
        cls, mechanism: Mechanism, frame_a: int, frame_b: int, *, stiffness: _Real, damping: _Real, rest: _Real
    ) -> Bushing: ...
    def directions(self, mechanism: Mechanism, q: _Real) -> _Real: ...
    def force(self, mechanism: Mechanism, q: _Real, qd: _Real) -> _Real: ...

@final
class LinearSystem:
    def __new__(
        cls,
        *,
        mass: _Real,
        damping: _Real,
        stiffness: _Real,
        directions: _Real,
        outputs: _Real,
        inputs: _Real,
        drives: _Real | None = None,
        drive_coordinates: Sequence[int] | None = None,
    ) -> LinearSystem: ...

@final
class Problem:
    def __new__(
        cls,
        targets: Sequence[tuple[LinearSystem, _Complex, _Complex, _Real]],
        *,
        prices: Sequence[_Real] | None = None,
        relative: bool = False,
    ) -> Problem: ...
    def reduce(self, stiffness: _Real, damping: _Real, free: Sequence[int | Sequence[int]]) -> _Real: ...
    def descend(
        self,
        stiffness: _Real,
        damping: _Real,
        free: Sequence[int | Sequence[int]],
        start: _Real,
        lower: _Real,
        upper: _Real,
        *,
        priors: Sequence[tuple[int, float, float]],
        tolerance: float,
        evaluations: int,
        radius: float,
        watch: Callable[[int, float], object] | None,
    ) -> tuple[_Real, float, _Real, float, _Real, Literal["converged", "limit", "interrupted"]]: ...
    def costs(self, stiffness: _Real, damping: _Real) -> _Real: ...

def descend(
    triangle: Callable[[_Real], _Real],
    start: _Real,
    lower: _Real,
    upper: _Real,
    *,
    tolerance: float,
    evaluations: int,
    radius: float,
    watch: Callable[[int, float], object] | None,
) -> tuple[_Real, float, _Real, float, _Real, Literal["converged", "limit", "interrupted"]]: ...
def follow(
    mass: _Real,
    damping: _Real,
    stiffness: _Real,
    drives: _Real,
    drive_coordinates: Sequence[int],
    springs: _Real,
    poles: _Complex,
    shapes: _Complex,
) -> tuple[_Complex, _Complex, NDArray[np.float32], _Real, _Real]: ...
def polynomial_backward_errors(coefficients: _Real, poles: _Complex) -> _Real: ...
def polynomial_eigenvalues(coefficients: Sequence[_Real]) -> tuple[list[_Complex], list[int], list[bool]]: ...
def polynomial_shapes(coefficients: _Real, poles: _Complex) -> _Complex: ...
def responses(
    systems: Sequence[LinearSystem], stiffness: _Real, damping: _Real, s: _Complex, *, sensitivities: bool = False
) -> tuple[_Complex, _Complex | None]: ...

@final
class Plant:
    def __new__(
        cls,
        mechanism: Mechanism,
        *,
        reference: _Real,
        moving: Sequence[int],
        springs: _Real,
        drags: _Real,
        preload: _Real,
        bushings: Sequence[Bushing],
        motors: _Real,
        feedforward: _Real,
        position: _Real,
        velocity: _Real,
        integral: _Real,
        integrating: Sequence[int],
        excitations: Sequence[tuple[int, Sequence[float], bool, str, Sequence[float], Sequence[float]]],
    ) -> Plant: ...
    @property
    def states(self) -> int: ...
    def rates(self, t: float, y: _Real, within: float) -> _Real: ...
    def record(self, t: float, y: _Real, within: float) -> _Real: ...
    def breaks(self) -> list[float]: ...
    def run(
        self,
        start: _Real,
        *,
        longest: float,
        step: float,
        samples: int,
        relative: float,
        absolute: _Real,
        sampled: tuple[float, float, bool, Sequence[float], Sequence[float], Sequence[float]] | None,
        progress: Callable[[float], object] | None,
    ) -> tuple[_Real, Literal["complete", "diverged", "stalled", "interrupted"], float, int, int, int, int]: ...
