"""The tables of Huynh et al. 2021, printed and independently recomputed, come out of the shipped robots."""

from __future__ import annotations

import numpy as np
import pytest

import armonic as am
from published import HUYNH_3R, KUKA_KR90, Elasticity, ModalTable

COLUMNS = ("earlier_work", "fit_modelled", "fit_measured", "fit_synthesized")


@pytest.fixture(scope="module")
def three_axes() -> am.LinearModel:
    return am.linearize(am.load("huynh_3r"), "milling")


def kuka_with(column: str) -> am.Robot:
    """The shipped robot with one column of Table 5."""
    elasticity: Elasticity = getattr(KUKA_KR90, column)
    joints = [f"links.{link}.elasticity.{key}" for link in KUKA_KR90.links for key in KUKA_KR90.keys]
    values = {f"{joint}.stiffness": k for joint, k in zip(joints, elasticity.stiffness, strict=True)}
    values |= {f"{joint}.damping": d for joint, d in zip(joints, elasticity.damping, strict=True)}
    return am.load("kuka_kr90").with_values(values)


# --- The three-axis example of section 4 --------------------------------------------------------------------


def test_mass_matrix_of_eq_33_matches_the_recomputation(three_axes):
    # Half of the last digit given.
    np.testing.assert_allclose(three_axes.mass, HUYNH_3R.mass_matrix, rtol=0, atol=0.005)


def test_mass_matrix_of_eq_33_matches_the_print_within_the_rounding_of_table_2(three_axes):
    # What half a millimetre in every centre of mass of Table 2 adds up to, and half of the last digit printed.
    rounding = np.array([[0.61, 0.22, 0.02], [0.22, 0.48, 0.22], [0.02, 0.22, 0.10]]) + 0.05
    assert (np.abs(three_axes.mass - HUYNH_3R.printed_mass_matrix) <= rounding).all()


def test_gravity_stiffness_of_eq_34_matches_the_recomputation(three_axes):
    gravity = three_axes.stiffness - np.diag(HUYNH_3R.stiffness)
    # Half of the last digit given; the springs of 3e6 N m/rad round to 1e-9.
    np.testing.assert_allclose(gravity, HUYNH_3R.gravity_stiffness, rtol=0, atol=5e-4)
    np.testing.assert_allclose(three_axes.free_stiffness, HUYNH_3R.gravity_stiffness, rtol=0, atol=5e-4)


def test_the_427_9_of_eq_34_matches_the_print_within_the_rounding_of_table_2(three_axes):
    # It is m3 g times a horizontal distance, and Table 2 rounds every centre of mass to a millimetre.
    rounding = HUYNH_3R.bodies[2].mass * 9.81 * 0.5e-3
    assert three_axes.stiffness[1, 2] == pytest.approx(HUYNH_3R.printed_gravity_stiffness_23, abs=rounding)
    assert three_axes.stiffness[1, 2] == pytest.approx(427.9, abs=0.05)


def test_tangent_damping_at_rest_is_the_joint_dampers_alone(three_axes):
    # The off-diagonal entries that Eq. 33 prints are residue: nothing turns, so nothing is gyroscopic.
    np.testing.assert_allclose(three_axes.damping, np.diag(HUYNH_3R.damping), rtol=0, atol=1e-9)


def test_modal_parameters_of_section_4_match_the_recomputation(three_axes):
    modes = am.modes(three_axes)
    # Half of the last digit given.
    np.testing.assert_allclose(modes.damped_freq_hz, HUYNH_3R.modes.damped_freq_hz, rtol=0, atol=5.01e-4)
    np.testing.assert_allclose(modes.natural_freq_hz, HUYNH_3R.natural_freq_hz, rtol=0, atol=5.01e-4)
    np.testing.assert_allclose(modes.damping_ratio, HUYNH_3R.modes.damping_ratio, rtol=0, atol=5.01e-6)
    assert modes.stability == "asymptotically stable"


def test_modal_parameters_of_section_4_match_the_print(three_axes):
    modes, printed = am.modes(three_axes), HUYNH_3R.printed_modes
    # One unit of the last digit: the paper cuts 10.178 off to 10.17.
    assert (np.abs(modes.damped_freq_hz - printed.damped_freq_hz) <= [0.01, 0.01, 0.1]).all()
    assert (np.abs(modes.damping_ratio - printed.damping_ratio) <= [1e-4, 1e-3, 1e-4]).all()


# --- The KUKA of section 5 ----------------------------------------------------------------------------------


@pytest.mark.parametrize("column", COLUMNS)
def test_table_6_matches_the_recomputation(column):
    modes = am.modes(kuka_with(column), "milling")
    expected: ModalTable = getattr(KUKA_KR90, f"modes_{column}")
    assert len(modes) == 9
    # Half of the last digit given.
    np.testing.assert_allclose(modes.damped_freq_hz[:4], expected.damped_freq_hz, rtol=0, atol=0.005)
    np.testing.assert_allclose(modes.damping_ratio[:4], expected.damping_ratio, rtol=0, atol=5.01e-5)


@pytest.mark.parametrize("column", COLUMNS)
def test_table_6_matches_the_print_within_the_rounding_of_table_5(column):
    modes = am.modes(kuka_with(column), "milling")
    printed: ModalTable = getattr(KUKA_KR90, f"printed_modes_{column}")
    freq_hz, ratio = np.array(printed.damped_freq_hz), np.array(printed.damping_ratio)
    # Half of the last digit printed. On top of it, Table 5 gives a stiffness to 2 % (0.05 of 2.7), of which a frequency
    # takes half at most, and a damping to 25 % (0.05 of 0.2).
    assert (np.abs(modes.damped_freq_hz[:4] - freq_hz) <= 0.05 + 0.01 * freq_hz).all()
    assert (np.abs(modes.damping_ratio[:4] - ratio) <= 0.0005 + 0.25 * ratio).all()


def test_the_shipped_robot_has_the_nine_recomputed_frequencies_of_the_column_from_34():
    modes = am.modes(am.load("kuka_kr90"), "milling")
    expected = KUKA_KR90.all_damped_freq_hz_earlier_work
    np.testing.assert_allclose(modes.damped_freq_hz, expected, rtol=0, atol=0.005)  # half of the last digit given


def test_the_fit_on_synthesized_responses_has_a_fifth_mode_in_the_band():
    modes = am.modes(kuka_with("fit_synthesized"), "milling")
    assert modes.damped_freq_hz[4] == pytest.approx(KUKA_KR90.fifth_damped_freq_hz_fit_synthesized, abs=0.005)
    assert modes.damped_freq_hz[5] > 30.0


def test_the_modes_move_the_joints_that_the_paper_names():
    # Section 5: the first about z of joint 1, the second about z of joint 2, the fourth about z of joint 3.
    modes = am.modes(am.load("kuka_kr90"), "milling")
    movers = [modes.movers(mode)[0][0] for mode in range(4)]
    assert [movers[0], movers[1], movers[3]] == ["carousel.z", "link_arm.z", "arm.z"]
    # The third combines z and x of joint 1.
    assert {"carousel.z", "carousel.x"} & {name for name, _ in modes.movers(2)}
