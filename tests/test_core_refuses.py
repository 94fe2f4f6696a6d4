"""The core refuses what it cannot compute, by name: bad arguments, and coordinates without mass."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from armonic import _core
from trees import Array


def changed(values: Array, index: Any, value: float) -> Array:
    out = np.array(values, dtype=float)
    out[index] = value
    return out


# A slider on a turntable, with a plate welded on.
EYES = np.tile(np.eye(4), (3, 1, 1))
TABLE: dict[str, Any] = {
    "parents": [-1, 0, 1],
    "placements": EYES,
    "kinds": ["revolute", "prismatic", "fixed"],
    "axes": np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]),
    "masses": np.array([3.0, 2.0, 1.0]),
    "coms": np.full((3, 3), 0.1),
    "inertias": np.tile(0.2 * np.eye(3), (3, 1, 1)),
    "frame_nodes": [-1, 2],
    "frame_placements": EYES[:2],
    "gravity": [0.0, 0.0, -9.81],
}
N, FRAMES = 2, 2
Q, QD, QDD = (np.full(N, value) for value in (0.1, 0.2, 0.3))
SHORT, NOT_A_NUMBER, INFINITE = Q[:1], changed(Q, 1, np.nan), changed(Q, 0, np.inf)


def build(**change: Any) -> _core.Mechanism:
    return _core.Mechanism(**(TABLE | change))


def test_the_table_without_a_fault_is_accepted():
    assert build().n == N


# Argument at fault, its value, what the message must say besides.
FAULTS: dict[str, tuple[str, Any, str]] = {
    "a parent after its child": ("parents", [-1, 2, 1], "node 1.* parent 2"),
    "a node as its own parent": ("parents", [0, 0, 1], "node 0.* parent 0"),
    "too few placements": ("placements", EYES[:2], r"placements: .*\[2, 4, 4\], expected \(3, 4, 4\)"),
    "a placement that is not a number": ("placements", changed(EYES, (1, 0, 3), np.nan), "placement.*NaN"),
    "a turn that is not a number": ("placements", changed(EYES, (1, 0, 0), np.nan), "placement"),
    "a stretched placement": ("placements", changed(EYES, (1, 0, 0), 1.01), "placements: .*not a rigid"),
    "a mirrored placement": ("placements", changed(EYES, (1, 0, 0), -1.0), "placements: .*not a rigid"),
    "a projective placement": ("placements", changed(EYES, (1, 3, 0), 1.0), "placements: .*not a rigid"),
    "too few kinds": ("kinds", ["revolute", "fixed"], "kinds: "),
    "an unknown kind": ("kinds", ["revolute", "helical", "fixed"], 'kinds: found "helical"'),
    "too few axes": ("axes", TABLE["axes"][:2], "axes: "),
    "an axis of no length": ("axes", changed(TABLE["axes"], (1, 0), 0.0), "axes: node 1"),
    "an axis that is not a number": ("axes", changed(TABLE["axes"], (1, 0), np.nan), "axes: node 1"),
    "too few masses": ("masses", TABLE["masses"][:2], "masses: "),
    "a negative mass": ("masses", changed(TABLE["masses"], 1, -1.0), "mass: found -1"),
    "too few centres of mass": ("coms", TABLE["coms"][:2], "coms: "),
    "too few tensors": ("inertias", TABLE["inertias"][:2], "inertias: "),
    "a tensor that is not a number": ("inertias", changed(TABLE["inertias"], (0, 0, 0), np.nan), "inertia"),
    "a frame on no node": ("frame_nodes", [-1, 3], "node of a frame: found index 3"),
    "too few frame placements": ("frame_placements", EYES[:1], "frame_placements: "),
    "a stretched frame": ("frame_placements", 2.0 * EYES[:2], "frame_placements: .*not a rigid"),
    "a frame that is not a number": ("frame_placements", changed(EYES[:2], (1, 0, 3), np.nan), "placement"),
    "gravity of two numbers": ("gravity", [0.0, 0.0], "gravity"),
    "gravity that is not a number": ("gravity", [0.0, 0.0, np.nan], "gravity: found NaN"),
    "an infinite axis": ("axes", changed(TABLE["axes"], (1, 0), np.inf), "axes: node 1"),
    "a mass that is not a number": ("masses", changed(TABLE["masses"], 1, np.nan), "mass"),
    "a centre of mass that is not a number": ("coms", changed(TABLE["coms"], (0, 0), np.nan), "com"),
    "an asymmetric tensor": ("inertias", changed(TABLE["inertias"], (0, 0, 1), 0.1), "inertias"),
    "a parent below the base": ("parents", [-1, 0, -2], "parent"),
    "a frame below the base": ("frame_nodes", [-1, -2], "frame"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_building_refuses(fault):
    argument, value, message = FAULTS[fault]
    with pytest.raises(ValueError, match=message):
        build(**{argument: value})


# --- Calls ------------------------------------------------------------------------------------------------

# Every method, called with one of its arguments replaced.
METHODS: dict[str, tuple[tuple[str, ...], Callable[..., Array]]] = {
    "pose": (("q",), lambda m, q: m.pose(q, 1)),
    "jacobian": (("q",), lambda m, q: m.jacobian(q, 1)),
    "mass_matrix": (("q",), lambda m, q: m.mass_matrix(q)),
    "gravity_torque": (("q",), lambda m, q: m.gravity_torque(q)),
    "bias": (("q", "qd"), lambda m, q, qd: m.bias(q, qd)),
    "inverse_dynamics": (("q", "qd", "qdd"), lambda m, q, qd, qdd: m.inverse_dynamics(q, qd, qdd)),
    "forward_dynamics": (("q", "qd", "tau"), lambda m, q, qd, tau: m.forward_dynamics(q, qd, tau)),
    "linearize": (("q", "qd", "qdd"), lambda m, q, qd, qdd: m.linearize(q, qd, qdd)),
}
ARGUMENTS = [(method, name) for method, (names, _) in METHODS.items() for name in names]


@pytest.mark.parametrize(
    "value",
    [SHORT, NOT_A_NUMBER, INFINITE, np.zeros((2, 2, N)), np.zeros((3, N + 1)), np.array(0.0)],
    ids=["short", "NaN", "infinite", "three axes", "wide batch", "scalar"],
)
@pytest.mark.parametrize(("method", "name"), ARGUMENTS)
def test_every_method_refuses_a_vector_that_does_not_fit_by_name(method, name, value):
    names, call = METHODS[method]
    with pytest.raises(ValueError, match=rf"^{name}: "):
        call(build(), *(value if other == name else Q for other in names))


@pytest.mark.parametrize(("method", "name"), [(m, n) for m, n in ARGUMENTS if n != "q"])
def test_every_method_refuses_batches_of_unlike_length(method, name):
    names, call = METHODS[method]
    batch, longer = np.zeros((3, N)), np.zeros((4, N))
    for value in (longer, Q):
        with pytest.raises(ValueError, match=rf"^{name}: "):
            call(build(), *(value if other == name else batch for other in names))


def test_a_bad_row_in_a_batch_is_refused():
    batch = np.stack([Q, Q, NOT_A_NUMBER, Q])
    with pytest.raises(ValueError, match=r"^q: found NaN"):
        build().mass_matrix(batch)


WRENCH_CALLS: dict[str, Callable[[_core.Mechanism, Any], Array]] = {
    "inverse_dynamics": lambda m, wrenches: m.inverse_dynamics(Q, QD, QDD, wrenches=wrenches),
    "forward_dynamics": lambda m, wrenches: m.forward_dynamics(Q, QD, QDD, wrenches=wrenches),
    "linearize": lambda m, wrenches: m.linearize(Q, QD, QDD, wrenches=wrenches),
}


@pytest.mark.parametrize("method", WRENCH_CALLS)
def test_a_wrench_on_an_unknown_frame_or_of_bad_numbers_is_refused(method):
    call = WRENCH_CALLS[method]
    with pytest.raises(ValueError, match="frame: found index 2, expected one below 2"):
        call(build(), [(FRAMES, [0.0] * 6)])
    for frame in range(FRAMES):
        with pytest.raises(ValueError, match="wrench: found NaN"):
            call(build(), [(frame, [0.0] * 5 + [np.nan])])
    with pytest.raises(ValueError, match="wrenches"):
        call(build(), [(0, [0.0] * 5)])


@pytest.mark.parametrize("call", [_core.Mechanism.pose, _core.Mechanism.jacobian])
def test_an_unknown_frame_is_refused(call):
    with pytest.raises(ValueError, match="frame: found index 2, expected one below 2"):
        call(build(), Q, FRAMES)


@pytest.mark.parametrize("call", [_core.Mechanism.pose, _core.Mechanism.jacobian])
def test_a_negative_frame_be_refused_by_name(call):
    with pytest.raises(ValueError, match="frame"):
        call(build(), Q, -1)


# --- Bushings ---------------------------------------------------------------------------------------------

SIX = np.eye(6)
BUSHING: dict[str, Any] = {"stiffness": SIX, "damping": SIX, "rest": Q}


@pytest.mark.parametrize(
    ("argument", "value", "message"),
    [
        ("stiffness", np.eye(5), r"^stiffness: .*\(6, 6\)"),
        ("stiffness", changed(SIX, (0, 1), np.nan), r"^stiffness: "),
        ("damping", np.ones(6), r"^damping: "),
        ("damping", changed(SIX, (5, 5), np.inf), r"^damping: "),
        ("rest", SHORT, r"^rest: "),
    ],
)
def test_a_bushing_refuses(argument, value, message):
    with pytest.raises(ValueError, match=message):
        _core.Bushing(build(), 0, 1, **(BUSHING | {argument: value}))


def test_a_bushing_calls_its_rest_by_name():
    with pytest.raises(ValueError, match=r"^rest: found NaN"):
        _core.Bushing(build(), 0, 1, **(BUSHING | {"rest": NOT_A_NUMBER}))


@pytest.mark.parametrize("frames", [(FRAMES, 0), (0, FRAMES)])
def test_a_bushing_to_an_unknown_frame_is_refused(frames):
    with pytest.raises(ValueError, match="frame: found index 2"):
        _core.Bushing(build(), *frames, **BUSHING)


@pytest.mark.parametrize("value", [SHORT, NOT_A_NUMBER], ids=["short", "NaN"])
def test_a_bushing_refuses_a_state_that_does_not_fit(value):
    mechanism = build()
    bushing = _core.Bushing(mechanism, 0, 1, **BUSHING)
    for call in (lambda: bushing.force(mechanism, value, QD), lambda: bushing.directions(mechanism, value)):
        with pytest.raises(ValueError, match=r"^q: "):
            call()
    with pytest.raises(ValueError, match=r"^qd: "):
        bushing.force(mechanism, Q, value)


def test_a_bushing_refuses_a_mechanism_without_its_frames():
    bushing = _core.Bushing(build(), 0, 1, **BUSHING)
    other = build(frame_nodes=[-1], frame_placements=EYES[:1])
    with pytest.raises(ValueError, match="frame: found index 1"):
        bushing.force(other, Q, QD)
    with pytest.raises(ValueError, match="frame: found index 1"):
        other.linearize(Q, QD, QDD, bushings=[bushing])


# --- No answer --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("batch", [False, True], ids=["single", "batch"])
def test_a_massless_coordinate_has_no_forward_dynamics(batch):
    # The slider carries nothing: no acceleration follows from a force on it.
    mechanism = build(masses=np.array([3.0, 0.0, 0.0]), inertias=changed(TABLE["inertias"], slice(1, 3), 0.0))
    q = np.stack([Q, Q]) if batch else Q
    assert np.isfinite(mechanism.inverse_dynamics(q, q, q)).all()
    with pytest.raises(ArithmeticError, match="mass matrix is not positive definite"):
        mechanism.forward_dynamics(q, q, q)


def test_two_coordinates_that_move_the_same_mass_have_no_forward_dynamics():
    # Both turn about one axis with no mass between them: the mass matrix is [[a, a], [a, a]].
    rng = np.random.default_rng(0)
    for _ in range(50):
        axis = rng.normal(size=3)
        twice = _core.Mechanism(
            parents=[-1, 0],
            placements=EYES[:2],
            kinds=["revolute", "revolute"],
            axes=np.array([axis, axis]),
            masses=np.array([0.0, 2.0]),
            coms=np.full((2, 3), 0.1),
            inertias=np.stack([np.zeros((3, 3)), 0.2 * np.eye(3)]),
            frame_nodes=[],
            frame_placements=np.zeros((0, 4, 4)),
            gravity=[0.0, 0.0, -9.81],
        )
        with pytest.raises(ArithmeticError):
            twice.forward_dynamics(Q, QD, QDD)
