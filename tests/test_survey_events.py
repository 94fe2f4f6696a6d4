"""Modes that meet: crossings, veerings and real poles, on systems whose behaviour is known in closed form."""

from __future__ import annotations

import numpy as np
import pytest

import armonic as am
from models import robot_of, slides, spring

TURN = 2 * np.pi


def side_by_side(*masses: float) -> am.Robot:
    """Masses on slides of their own on the base: nothing couples them."""
    links = [
        {"name": f"mass_{i}", "parent": "base", "joint": {"type": "prismatic", "axis": "x"},
         "elasticity": {"tx": spring(1e4, 4.0)}, "mass": mass}
        for i, mass in enumerate(masses)
    ]  # fmt: skip
    return robot_of(links)


@pytest.mark.parametrize("count", [8, 41, 400])
def test_modes_that_nothing_couples_cross_and_keep_their_shapes(count: int) -> None:
    robot, path = side_by_side(2.0, 2.0), "links.mass_1.elasticity.tx.stiffness"
    k = np.linspace(0.6e4, 1.41e4, count)
    survey = am.survey(robot, [0, 0], sweep={path: k}, shapes=True)
    # Mode 1 begins as the swept, softer one and stays it.
    np.testing.assert_allclose(survey.natural_freq_hz.values[:, 0], np.sqrt(k / 2) / TURN, rtol=1e-9)
    np.testing.assert_allclose(survey.natural_freq_hz.values[:, 1], np.sqrt(1e4 / 2) / TURN, rtol=1e-9)
    assert np.abs(survey.shape.values[:, 0, 0]).max() < 1e-9
    (place,) = np.flatnonzero((k[:-1] < 1e4) & (k[1:] >= 1e4)) + 1
    expected = np.zeros((count, 2), np.int8)
    expected[place] = 1
    np.testing.assert_array_equal(survey.event.values, expected)


def coupled(coupling: float) -> am.Robot:
    """Two masses of 2 kg, each on a spring to the ground, and a spring between them, in relative coordinates."""
    links = [
        {"name": "one", "parent": "base", "joint": {"type": "prismatic", "axis": "x"},
         "elasticity": {"tx": spring(1e4, 0.2)}, "mass": 2.0},
        {"name": "two", "parent": "base", "joint": {"type": "prismatic", "axis": "x"},
         "elasticity": {"tx": spring(1e4, 0.2)}, "mass": 2.0},
    ]  # fmt: skip
    rest = [0.0, 0.0]
    bushing = {"name": "between", "between": ["one", "two"], "stiffness": [coupling, 0, 0, 0, 0, 0], "rest": rest}
    return robot_of(links, bushings=[bushing])


@pytest.mark.parametrize("coupling", [300.0, 30.0, 3.0])
def test_coupled_modes_veer_where_their_gap_is_least_and_trade_shapes(coupling: float) -> None:
    robot, path = coupled(coupling), "links.two.elasticity.tx.stiffness"
    k = 1e4 + coupling * np.linspace(-8, 8, 161)
    survey = am.survey(robot, [0, 0], sweep={path: k}, shapes=True)
    # ω² of the 2x2 problem: mean ± the root of half difference and coupling.
    mean, half = (2e4 + 2 * coupling + k - 1e4) / 2, (k - 1e4) / 2
    for mode, sign in ((0, -1), (1, 1)):
        exact = np.sqrt((mean + sign * np.hypot(half, coupling)) / 2) / TURN
        np.testing.assert_allclose(survey.natural_freq_hz.values[:, mode], exact, rtol=1e-6)  # damping 1e-3
    # Damping shifts the least gap of the frequencies by less than a place.
    (places,) = np.nonzero(survey.event.values[:, 0] == 2)
    assert len(places) == 1
    assert abs(places[0] - 80) <= 1
    np.testing.assert_array_equal(survey.event.values[:, 0], survey.event.values[:, 1])
    lead = np.abs(survey.shape.values[:, 0])
    assert lead[0, 1] > 5 * lead[0, 0]
    assert lead[-1, 0] > 5 * lead[-1, 1]


def test_modes_that_come_near_without_coupling_are_no_veering() -> None:
    robot, path = side_by_side(2.0, 2.0), "links.mass_1.elasticity.tx.stiffness"
    k = 1.01e4 + 200 * np.linspace(-1, 1, 41) ** 2
    survey = am.survey(robot, [0, 0], sweep={path: k})
    assert not survey.event.values.any()


def test_a_pair_meets_on_the_real_axis_and_comes_back() -> None:
    robot = slides([2.0], [spring(800.0, 10.0)])
    d = np.concatenate([np.linspace(10, 160, 31), np.linspace(155, 10, 30)])  # critical at 80
    survey = am.survey(robot, [0.0], sweep={"links.mass_0.elasticity.tx.damping": d})
    root = np.sqrt((d / 4) ** 2 - 400 + 0j)
    first, second = -d / 4 + root, -d / 4 - root
    apart = np.abs(d - 80) > 1  # a double pole is known to the root of the rounding only
    pole, partner = survey.pole.values[:, 0], survey.partner.values[:, 0]
    np.testing.assert_allclose(pole[apart], first[apart], rtol=1e-9)
    np.testing.assert_allclose(partner[apart], second[apart], rtol=1e-9)
    over = d > 81
    np.testing.assert_array_equal(survey.damping_ratio.values[over, 0], 1.0)
    assert (survey.damped_freq_hz.values[over, 0] == 0).all()
    np.testing.assert_allclose(survey.natural_freq_hz.values[d < 79, 0], 20 / TURN, rtol=1e-9)


def test_two_pairs_that_meet_at_different_places_keep_their_slots() -> None:
    robot = side_by_side(2.0, 1.0)
    d = np.linspace(40, 500, 93)  # critical at 2 sqrt(k m): 282.8 and 200
    paths = [f"links.mass_{i}.elasticity.tx.damping" for i in range(2)]
    survey = am.survey(robot, [0, 0], sweep=dict.fromkeys(paths, d))
    for mode, mass in ((0, 2.0), (1, 1.0)):
        root = np.sqrt((d / (2 * mass)) ** 2 - 1e4 / mass + 0j)
        expected = np.stack([-d / (2 * mass) + root, -d / (2 * mass) - root], axis=1)
        found = np.stack([survey.pole.values[:, mode], survey.partner.values[:, mode]], axis=1)
        critical = 2 * np.sqrt(1e4 * mass)
        before = d < critical - 5
        np.testing.assert_allclose(found[before], expected[before], rtol=1e-9)
    # Once all poles are real, which two share a slot is a matter of history; together they are all there.
    late = d > 290
    all_found = np.sort(np.concatenate([survey.pole.values, survey.partner.values], axis=1)[late].real, axis=1)
    roots = [np.sqrt((d[late] / (2 * m)) ** 2 - 1e4 / m) for m in (2.0, 1.0)]
    exact = np.stack(
        [-d[late] / (2 * m) + s * r for m, r in zip((2.0, 1.0), roots, strict=True) for s in (1, -1)], axis=1
    )
    np.testing.assert_allclose(all_found, np.sort(exact, axis=1), rtol=1e-9)
