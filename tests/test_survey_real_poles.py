"""Poles that meet on the real axis keep their slot, together with those of other oscillators, and across blocks."""

from __future__ import annotations

import json
from collections.abc import Mapping

import numpy as np
import pytest
import xarray as xr
from numpy.typing import NDArray

import armonic as am
from armonic.surveying import running
from models import random_driven_robot, random_robot, robot_of, spring
from surveyed import smooth, worst
from trees import Array

STIFFNESS = {"a": 100.0, "b": 400.0, "c": 250.0}
AXES = {"a": "x", "b": "y", "c": "z"}
ORDER = "acb"
"""By natural frequency: the mode of each mass."""


@pytest.fixture(params=[4096, 16], ids=["one block", "many blocks"])
def blocks(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(running, "POSTURES_PER_BLOCK", request.param)
    monkeypatch.setattr(running, "FEWEST_PER_BLOCK", 1)


def three_slides() -> am.Robot:
    """Masses of 1 kg along x, y and z, which nothing couples; critical dampers are of 20, 40 and 31.6 N s/m."""
    links = [
        {
            "name": name,
            "parent": "base",
            "joint": {"type": "prismatic", "axis": axis},
            "elasticity": {f"t{axis}": spring(STIFFNESS[name], 1.0)},
            "mass": 1.0,
        }
        for name, axis in AXES.items()
    ]
    return robot_of(links, gravity=[0, 0, 0])


def swept(dampers: Mapping[str, Array]) -> xr.Dataset:
    sweep = {f"links.{name}.elasticity.t{AXES[name]}.damping": values for name, values in dampers.items()}
    return am.survey(three_slides(), [0, 0, 0], sweep=sweep, shapes=True)


def closed_form(damper: Array, name: str) -> NDArray[np.complex128]:
    """Both poles of a mass, (P, 2): the upper one or the slower one first."""
    root = np.sqrt(damper.astype(complex) ** 2 - 4 * STIFFNESS[name])
    return np.stack([-damper + root, -damper - root], axis=1) / 2


def slots(found: xr.Dataset) -> NDArray[np.complex128]:
    """Both poles of each mode, (P, m, 2)."""
    return np.stack([found.pole.values, found.partner.values], axis=-1)


def assert_slots_are_in_order(found: xr.Dataset) -> None:
    pole, partner = found.pole.values, found.partner.values
    pair = pole.imag > 0
    assert (partner[pair] == pole[pair].conj()).all()
    real = ~pair
    assert (pole.imag[real] == 0).all()
    there = ~np.isnan(partner[real])
    assert (partner[real][there].imag == 0).all()
    assert (pole[real][there].real >= partner[real][there].real).all()
    np.testing.assert_array_equal(found.damped_freq_hz.values[real], 0.0)


@pytest.mark.usefixtures("blocks")
@pytest.mark.parametrize("points", [7, 40, 301])
def test_one_oscillator_through_critical_damping_and_back(points):
    damper = np.r_[np.linspace(1, 60, points), np.linspace(60, 1, points)]
    found = swept({"a": damper})
    mode = slots(found)[:, 0]
    # Close to critical damping poles are known to rounding over their gap.
    np.testing.assert_allclose(mode, closed_form(damper, "a"), rtol=1e-10)
    assert_slots_are_in_order(found)
    assert found.mac.min() > 0.999


@pytest.mark.usefixtures("blocks")
def test_critical_damping_itself_is_a_double_pole():
    damper = np.r_[np.linspace(10, 20, 16), np.linspace(20, 30, 16), np.linspace(30, 20, 9)]
    found = swept({"a": damper})
    # A double pole is known to the square root of rounding.
    np.testing.assert_allclose(slots(found)[:, 0], closed_form(damper, "a"), rtol=1e-6)
    np.testing.assert_allclose(found.natural_freq_hz[damper == 20, 0], 10 / (2 * np.pi), rtol=1e-6)


@pytest.mark.usefixtures("blocks")
@pytest.mark.parametrize("seed", range(8))
def test_oscillators_that_are_overdamped_together_keep_their_slots(seed):
    # Their real poles pass each other in all ways.
    rng, t = np.random.default_rng(seed), np.linspace(0, 2 * np.pi, 201)
    dampers = {
        name: 1 + rng.uniform(28, 70) * (1 - np.cos(turns * t)) / 2
        for name, turns in zip(AXES, rng.integers(1, 4, 3), strict=True)
    }
    found = swept(dampers)
    for mode, name in enumerate(ORDER):
        np.testing.assert_allclose(slots(found)[:, mode], closed_form(dampers[name], name), rtol=1e-8)
        assert (np.abs(found["shape"].values[:, mode]).argmax(axis=1) == "abc".index(name)).all()
    assert_slots_are_in_order(found)
    assert set(np.unique(found.event)) <= {0, 1}


@pytest.mark.usefixtures("blocks")
@pytest.mark.parametrize("seed", range(6))
def test_oscillators_that_begin_overdamped_have_slots_of_their_own(seed):
    rng, t = np.random.default_rng(seed), np.linspace(0, 2 * np.pi, 201)
    dampers = {name: 35 * (1 + 0.99 * np.sin((i + 1) * t + rng.uniform(0, 6))) for i, name in enumerate(AXES)}
    found = swept(dampers)
    owners = np.abs(found["shape"].values).argmax(axis=2)
    assert (owners == owners[0]).all()
    assert sorted(owners[0]) == [0, 1, 2]
    for mode, owner in enumerate(owners[0]):
        name = "abc"[owner]
        np.testing.assert_allclose(slots(found)[:, mode], closed_form(dampers[name], name), rtol=1e-8)


@pytest.mark.usefixtures("blocks")
@pytest.mark.parametrize("damping", [1e-2, 3e-2, 1e-1])
@pytest.mark.parametrize(("seed", "n"), [(2, 3), (8, 5), (1, 5), (3, 8)])
def test_robots_with_overdamped_joints_have_the_poles_of_lapack(seed, n, damping):
    robot = random_robot(seed, n, damping=damping)
    postures = smooth(robot, 80, seed=seed, size=0.7)
    found = am.survey(robot, postures)
    assert worst(robot, postures, found) < 1e-9
    assert_slots_are_in_order(found)
    assert (found.pole.values.imag == 0).any()


def test_blocks_change_no_slot_of_real_poles(monkeypatch):
    robot = random_robot(8, 5, damping=3e-2)
    postures = smooth(robot, 80, seed=8, size=0.7)
    whole = am.survey(robot, postures)
    monkeypatch.setattr(running, "POSTURES_PER_BLOCK", 16)
    monkeypatch.setattr(running, "FEWEST_PER_BLOCK", 1)
    parts = am.survey(robot, postures)
    np.testing.assert_allclose(slots(parts), slots(whole), rtol=1e-9)


@pytest.mark.usefixtures("blocks")
@pytest.mark.parametrize("integrators", [1, 2, 3])
def test_an_odd_number_of_integrators_leaves_one_slot_without_partner(integrators):
    data = json.loads(random_driven_robot(1, 4).to_yaml())
    motors = len(data["control"]["kp"])
    assert motors >= 3
    data["control"] = {"kp": [2e4] * motors, "kd": [60.0] * motors}
    data["control"]["ki"] = [1e4] * integrators + [0.0] * (motors - integrators)
    robot = am.Robot.from_yaml(json.dumps(data))
    postures = smooth(robot, 60, seed=3, size=0.5)
    found = am.survey(robot, postures)
    poles = 2 * (4 + motors) + integrators
    assert found.sizes["mode"] == (poles + 1) // 2
    assert (np.isnan(found.partner).sum("mode") == poles % 2).all()
    assert not np.isnan(found.pole).any()
    assert worst(robot, postures, found) < 1e-9
    assert_slots_are_in_order(found)
