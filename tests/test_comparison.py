"""Comparison of two sets of modes: pairs by assignment, shapes over common coordinates, and what has no partner."""

from __future__ import annotations

from itertools import permutations
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import armonic as am
from armonic.comparison import ModeTable, compare, mode_table
from armonic.errors import SignalError
from models import random_robot

TURN = 2 * np.pi
ROUNDING = 1e-12  # of products of order one


@pytest.fixture(scope="module")
def scompi() -> am.Modes:
    return am.modes(am.load("scompi"), "c8")


def pole(freq_hz, damping):
    freq_hz, damping = np.asarray(freq_hz, float), np.asarray(damping, float)
    return TURN * freq_hz * (-damping + 1j * np.sqrt(1 - damping**2))


def pairs_of(comparison):
    return [(pair.index_a, pair.index_b) for pair in comparison.pairs]


def identified(modes, *, quantity="motor_position", keep=None, turn=1.0, part=".motor"):
    """What an ideal identification from such channels would give of a model's modes."""
    rate = {"position": 0, "velocity": 1, "acceleration": 2}[quantity.rpartition("_")[2]]
    rows = [i for i, name in enumerate(modes.coordinates) if name.endswith(part)]
    found = [
        SimpleNamespace(pole=complex(modes.poles[k]), shape=turn * modes.shapes[rows, k] * modes.poles[k] ** rate)
        for k in (range(len(modes)) if keep is None else keep)
    ]
    return SimpleNamespace(modes=tuple(found), channels=tuple(f"{quantity}:{modes.coordinates[i]}" for i in rows))


# --- Pairs --------------------------------------------------------------------------------------------------


def test_a_model_agrees_with_itself_in_every_mode(scompi):
    comparison = compare(scompi, scompi)
    assert pairs_of(comparison) == [(i, i) for i in range(12)]
    assert comparison.only_a == comparison.only_b == ()
    for pair in comparison.pairs:
        assert (pair.freq_difference, pair.damping_difference) == (0.0, 0.0)
        assert pair.mac == pytest.approx(1.0, rel=ROUNDING)


def test_differences_are_counted_from_the_second_set():
    (pair,) = compare([(10.1, 0.021)], [(10.0, 0.020)]).pairs
    assert pair.freq_difference == pytest.approx(0.01, rel=1e-10)
    assert pair.damping_difference == pytest.approx(0.001, rel=1e-10)
    assert pair.mac is None


def test_a_mode_does_not_take_the_only_partner_of_another():
    # Nearest first would pair 11.0 with 10.9 and leave 10.0 and 12.1 alone, or apart by a sixth.
    comparison = compare([(10.0, 0.02), (11.0, 0.02)], [(10.9, 0.02), (12.1, 0.02)], max_freq_difference=0.2)
    assert pairs_of(comparison) == [(0, 0), (1, 1)]


def test_exact_partners_are_not_given_up_to_pair_one_more():
    comparison = compare([(f, 0.02) for f in (10.0, 11.0, 12.0)], [(f, 0.02) for f in (11.0, 12.0, 13.0)])
    assert pairs_of(comparison) == [(1, 0), (2, 1)]
    assert comparison.only_a == (0,)
    assert comparison.only_b == (2,)


frequencies = st.lists(st.tuples(st.floats(5.0, 15.0), st.floats(0.0, 0.2)), min_size=1, max_size=5)


@settings(max_examples=100, deadline=None)
@given(frequencies, frequencies)
def test_no_other_way_to_pair_costs_less(a, b):
    comparison = compare(a, b, max_freq_difference=0.2)
    p, q = (pole(*np.array(side).T) for side in (a, b))
    size = np.maximum.outer(abs(p), abs(q))
    cost = abs(np.subtract.outer(p, q)) / size / 0.2
    cost = np.where(abs(np.subtract.outer(abs(p), abs(q))) > 0.2 * size, 1.0, np.minimum(cost, 1.0))
    small, large = (cost, cost.shape) if len(a) <= len(b) else (cost.T, cost.T.shape)
    least = min(sum(small[i, j] for i, j in enumerate(choice)) for choice in permutations(range(large[1]), large[0]))
    found = sum(cost[i, j] for i, j in pairs_of(comparison)) + min(cost.shape) - len(comparison.pairs)
    assert found == pytest.approx(least, abs=1e-9)


@settings(max_examples=50, deadline=None)
@given(frequencies, frequencies)
def test_every_mode_is_in_one_pair_or_said_to_have_none(a, b):
    comparison = compare(a, b)
    assert sorted([i for i, _ in pairs_of(comparison)] + list(comparison.only_a)) == list(range(len(a)))
    assert sorted([j for _, j in pairs_of(comparison)] + list(comparison.only_b)) == list(range(len(b)))
    for pair in comparison.pairs:
        assert abs(a[pair.index_a][0] - b[pair.index_b][0]) <= 0.2 * max(a[pair.index_a][0], b[pair.index_b][0])
    turned = compare(b, a)
    assert len(turned.pairs) == len(comparison.pairs)


def test_frequencies_too_far_apart_are_never_a_pair():
    assert len(compare([(10.0, 0.02)], [(11.0, 0.02)], max_freq_difference=0.1).pairs) == 1  # 1/11 of the higher
    assert compare([(10.0, 0.02)], [(11.0, 0.02)], max_freq_difference=0.09).pairs == ()


def test_damping_tells_modes_of_one_frequency_apart():
    comparison = compare([(10.0, 0.10), (10.0, 0.02)], [(10.01, 0.021), (9.99, 0.099)])
    assert pairs_of(comparison) == [(1, 0), (0, 1)]


def test_an_empty_set_leaves_every_mode_without_partner(scompi):
    comparison = compare([], scompi)
    assert comparison.pairs == ()
    assert comparison.only_b == tuple(range(12))


# --- Shapes -------------------------------------------------------------------------------------------------


def test_shapes_decide_between_modes_that_have_crossed():
    shapes = np.array([[1.0, 1.0, 0.5], [1.0, -1.0, 0.2]], complex)
    a = ModeTable(pole([10.0, 10.1], [0.02, 0.02]), shapes, ("x", "y", "z"))
    b = ModeTable(pole([10.0, 10.1], [0.02, 0.02]), shapes[::-1], ("x", "y", "z"))
    comparison = compare(a, b)
    assert pairs_of(comparison) == [(1, 0), (0, 1)]
    np.testing.assert_allclose(comparison.mac, am.mac(shapes.T, shapes[::-1].T), rtol=ROUNDING)


@pytest.mark.parametrize("quantity", ["motor_position", "motor_velocity"])
def test_motor_signals_are_compared_with_the_motors_of_the_model(scompi, quantity):
    result = identified(scompi, quantity=quantity, turn=2.0 - 3.0j)
    comparison = compare(result, scompi)
    assert pairs_of(comparison) == [(i, i) for i in range(12)]
    assert comparison.coordinates == tuple(f"link_{i}.motor" for i in range(1, 7))
    motors = scompi.shapes[6:]
    np.testing.assert_allclose(comparison.mac, am.mac(motors, motors), rtol=1e-9, atol=1e-12)


def test_accelerations_of_links_are_compared_with_the_links_of_the_model(scompi):
    result = identified(scompi, quantity="joint_acceleration", part=".z")
    comparison = compare(result, scompi)
    assert comparison.coordinates == tuple(f"link_{i}.z" for i in range(2, 7))
    assert all(pair.mac == pytest.approx(1.0, rel=1e-9) for pair in comparison.pairs)


def test_channels_may_be_objects_with_a_label(scompi):
    result = identified(scompi)
    result.channels = tuple(SimpleNamespace(label=label) for label in result.channels)
    assert compare(result, scompi).coordinates == tuple(f"link_{i}.motor" for i in range(1, 7))


def test_torques_are_no_motion_and_leave_pairing_to_frequency_and_damping(scompi):
    result = identified(scompi)
    result.channels = tuple(label.replace("motor_position", "motor_torque") for label in result.channels)
    comparison = compare(result, scompi)
    assert comparison.mac is None
    assert pairs_of(comparison) == [(i, i) for i in range(12)]


def test_one_common_coordinate_says_nothing_about_shapes(scompi):
    result = identified(scompi)
    result.channels = (*result.channels[:1], *(f"acceleration:tool.{i}" for i in range(5)))
    assert compare(result, scompi).mac is None


def test_two_models_of_one_robot_are_weighed_by_its_mass():
    robot = random_robot(3, 5, damping=0.1)
    a, b = am.modes(robot, "bent"), am.modes(robot, np.full(5, 0.1))
    np.testing.assert_array_equal(compare(a, b, max_freq_difference=0.9).mac, am.mac(a, b))


def test_shapes_less_alike_than_asked_are_never_a_pair():
    a = ModeTable(pole([10.0], [0.02]), np.array([[1.0, 0.2]], complex), ("x", "y"))
    b = ModeTable(pole([10.0], [0.02]), np.array([[1.0, 1.0]], complex), ("y", "x"))
    alike = 1.2**2 / (1.04 * 2)  # (1·1 + 0.2·1)² over the squared lengths
    assert compare(a, b).pairs[0].mac == pytest.approx(alike, rel=ROUNDING)
    assert len(compare(a, b, least_mac=alike - 1e-6).pairs) == 1
    assert compare(a, b, least_mac=alike + 1e-6).pairs == ()


def test_a_shape_that_is_not_known_neither_helps_nor_hinders():
    shapes = np.array([[1.0, 0.2], [np.nan, np.nan]], complex)
    a = ModeTable(pole([10.0, 20.0], [0.02, 0.02]), shapes, ("x", "y"))
    comparison = compare(a, a, least_mac=0.9)
    assert pairs_of(comparison) == [(0, 0), (1, 1)]
    assert comparison.pairs[1].mac is None


# --- Words --------------------------------------------------------------------------------------------------


def test_the_table_says_what_has_no_partner(scompi):
    found = identified(scompi, keep=[k for k in range(12) if k not in (4, 11)])
    found.modes = (*found.modes, SimpleNamespace(pole=complex(pole(300.0, 0.01)), shape=np.ones(6, complex)))
    comparison = compare(found, scompi)
    lines = repr(comparison).splitlines()
    assert len(lines) == 1 + 10 + 1 + 2
    assert lines[1].split() == ["1", "1", "6.3692", "6.3692", "+0.000", "7.669", "7.669", "+0.000", "1.000"]
    assert lines[11] == "mode 11 of a, 300.0000 Hz at 1.000 %, has no partner"
    assert lines[12].startswith("mode 5 of b, 13.14")
    assert lines[13].startswith("mode 12 of b, 850.8")


def test_modes_may_be_given_as_numbers_or_as_objects_that_have_them():
    listed = [SimpleNamespace(natural_freq_hz=10.0, damping_ratio=0.02), (20.0, 0.5), [0.0, 0.0]]
    table = mode_table(listed)
    np.testing.assert_allclose(table.natural_freq_hz, [10.0, 20.0, 0.0], rtol=ROUNDING)
    np.testing.assert_allclose(table.damping_ratio, [0.02, 0.5, 0.0], rtol=ROUNDING)
    assert pairs_of(compare(listed, table)) == [(0, 0), (1, 1), (2, 2)]


# --- Bad input ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("modes", "words"),
    [
        (7, "a: found int"),
        ("modes", "a: found str"),
        ([(10.0, 2.0)], "divided by 100"),
        ([(10.0,)], r"a\[0\]"),
        ([(10.0, 0.1), (-1.0, 0.1)], r"a\[1\].*not negative"),
        ([(np.nan, 0.1)], r"a\[0\]"),
        ([("ten", 0.1)], r"a\[0\]"),
    ],
)
def test_what_is_no_set_of_modes_is_refused(modes, words):
    with pytest.raises(SignalError, match=words):
        compare(modes, [(10.0, 0.02)])


@pytest.mark.parametrize(
    "limits", [{"max_freq_difference": 0.0}, {"max_freq_difference": np.nan}, {"least_mac": 1.1}, {"least_mac": -0.5}]
)
def test_a_limit_outside_its_range_is_refused(limits):
    with pytest.raises(SignalError, match=next(iter(limits))):
        compare([(10.0, 0.02)], [(10.0, 0.02)], **limits)


def test_a_least_mac_without_common_coordinates_is_refused(scompi):
    with pytest.raises(SignalError, match=r"0 common coordinates.*no coordinates and link_1\.tz"):
        compare([(10.0, 0.02)], scompi, least_mac=0.5)


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ({"poles": np.array([np.inf + 0j])}, "finite"),
        ({"poles": np.ones((2, 2), complex)}, r"\(m,\)"),
        ({"poles": np.ones(1, complex), "coordinates": ("x",)}, "both or neither"),
        ({"poles": np.ones(1, complex), "shapes": np.ones((2, 1), complex), "coordinates": ("x",)}, r"\(1, 1\)"),
        ({"poles": np.ones(1, complex), "shapes": np.ones((1, 2), complex), "coordinates": ("x", "x")}, "'x' twice"),
    ],
)
def test_a_table_whose_parts_do_not_fit_is_refused(parts, words):
    with pytest.raises(SignalError, match=words):
        ModeTable(**parts)
