"""Single-mode criteria against their definitions, and what a stabilization says of every pole."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import armonic as am
from armonic.errors import SignalError
from armonic.identification.poles import ModelPoles
from armonic.identification.shape_criteria import (
    LAGS_PER_PERIOD,
    PERIODS,
    mac_rows,
    mac_table,
    mean_phase_deviation_deg,
    mean_shape,
    modal_phase_collinearity,
    omac_rows,
)
from armonic.identification.stabilization import Criteria, stabilize

TURN = 2 * np.pi
ROUNDING = 1e-12  # sums of some ten products of order one


def shapes_of(seed, count, channels=6):
    rng = np.random.default_rng(seed)
    return rng.normal(size=(count, channels)) + 1j * rng.normal(size=(count, channels))


def pole(freq_hz, damping):
    freq_hz, damping = np.asarray(freq_hz, float), np.asarray(damping, float)
    return TURN * freq_hz * (-damping + 1j * np.sqrt(1 - damping**2))


def random_models(seed, orders=range(2, 12), channels=3):
    rng = np.random.default_rng(seed)
    return [
        ModelPoles(
            p, pole(rng.uniform(1, 100, 3 * p), rng.uniform(-0.1, 0.9, 3 * p)), shapes_of([seed, p], 3 * p, channels)
        )
        for p in orders
    ]


# --- Criteria of shapes -------------------------------------------------------------------------------------


def test_mac_of_rows_and_tables_is_that_of_the_modal_analysis():
    a, b = shapes_of(0, 5), shapes_of(1, 5)
    expected = am.mac(a.T, b.T)
    np.testing.assert_allclose(mac_table(a, b), expected, rtol=ROUNDING)
    np.testing.assert_allclose(mac_rows(a, b), np.diag(expected), rtol=ROUNDING)


@pytest.mark.parametrize(("freq", "damping"), [(6.0, 0.0), (6.05, 0.02), (6.3, 0.3), (12.0, 0.8), (6.0, -0.05)])
def test_omac_is_the_mac_of_shapes_written_one_below_the_other_over_the_lags(freq, damping):
    a, b = shapes_of(2, 1), shapes_of(3, 1)
    poles = pole(6.0, 0.02), pole(freq, damping)
    lag = TURN / np.sqrt(abs(poles[0]) * abs(poles[1])) / LAGS_PER_PERIOD
    times = lag * np.arange(PERIODS * LAGS_PER_PERIOD)
    long = [np.kron(np.exp(p * times), shape[0]) for p, shape in zip(poles, (a, b), strict=True)]
    expected = abs(np.vdot(*long)) ** 2 / np.vdot(long[0], long[0]).real / np.vdot(long[1], long[1]).real
    found = omac_rows(np.array([poles[0]]), a, np.array([poles[1]]), b)
    # 64 terms each, of which the largest dominate.
    np.testing.assert_allclose(found, expected, rtol=1e-10)


def test_omac_of_equal_poles_is_the_mac_and_a_detuned_pole_lowers_it():
    a, b = shapes_of(4, 1), shapes_of(5, 1)
    poles = pole([10.0, 10.1, 10.5, 12.0], 0.01)
    omac = [float(omac_rows(poles[:1], a, poles[i : i + 1], b)[0]) for i in range(4)]
    assert omac[0] == pytest.approx(float(mac_rows(a, b)[0]), rel=1e-10)
    assert omac[0] > omac[1] > omac[2] > omac[3]


def test_omac_of_motions_that_have_nothing_in_common_is_zero_without_a_warning():
    a = shapes_of(6, 3)
    assert omac_rows(np.array([0, 1e-30, -1e6 + 1j]), a, pole([10.0, 10.0, 10.0], 0.1), a).tolist() == [0.0, 0.0, 0.0]


def test_mpc_is_the_spread_of_the_two_principal_parts_of_a_shape():
    shapes = shapes_of(7, 20)
    for shape, found in zip(shapes, modal_phase_collinearity(shapes), strict=True):
        low, high = np.linalg.eigvalsh(np.array([shape.real, shape.imag]) @ np.array([shape.real, shape.imag]).T)
        assert found == pytest.approx(((high - low) / (high + low)) ** 2, rel=1e-9, abs=ROUNDING)


def test_mpd_is_the_angle_to_the_first_singular_vector_weighted_by_amplitude():
    shapes = shapes_of(8, 20)
    for shape, found in zip(shapes, mean_phase_deviation_deg(shapes), strict=True):
        normal = np.linalg.svd(np.column_stack([shape.real, shape.imag]))[2][1]
        # Reynders et al. 2012: arccos |Re φ V22 − Im φ V12| / |φ|, the cosine of the angle to the line.
        cosine = np.abs(shape.real * normal[1] - shape.imag * normal[0]) / np.abs(shape)
        assert found == pytest.approx(np.degrees(np.average(np.arccos(cosine), weights=np.abs(shape))), rel=1e-6)


def test_a_real_shape_is_collinear_and_a_circle_has_no_preferred_phase():
    real, circle = shapes_of(9, 1).real.astype(complex), np.exp(1j * TURN * np.arange(6) / 6)[None]
    assert modal_phase_collinearity(real) == pytest.approx(1.0, rel=ROUNDING)
    assert mean_phase_deviation_deg(real) == pytest.approx(0.0, abs=1e-9)
    assert modal_phase_collinearity(circle) == pytest.approx(0.0, abs=ROUNDING)
    # Rays sixty degrees apart: (0 + 60 + 60) / 3 with the line on one of them, (30 + 30 + 90) / 3 between two.
    assert 39.999 < float(mean_phase_deviation_deg(circle)[0]) < 50.001


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 1000), st.floats(1e-3, 1e3), st.floats(0, TURN))
def test_no_criterion_depends_on_how_a_shape_is_scaled_or_turned(seed, size, angle):
    shapes = shapes_of(seed, 3)
    turned = shapes * size * np.exp(1j * angle)
    np.testing.assert_allclose(mac_rows(shapes, turned), 1.0, rtol=ROUNDING)
    # The angle of φᵀφ is known to rounding over |φᵀφ|, which may be small.
    np.testing.assert_allclose(modal_phase_collinearity(turned), modal_phase_collinearity(shapes), atol=1e-10)
    np.testing.assert_allclose(mean_phase_deviation_deg(turned), mean_phase_deviation_deg(shapes), atol=1e-6)


def test_the_mean_of_a_shape_at_any_phase_is_that_shape():
    rng = np.random.default_rng(10)
    shape = shapes_of(10, 1)[0]
    turned = shape * (rng.uniform(0.1, 10, 30) * np.exp(1j * rng.uniform(0, TURN, 30)))[:, None]
    found = mean_shape(turned, np.ones(30))
    assert np.linalg.norm(found) == pytest.approx(1.0, rel=ROUNDING)
    assert abs(np.vdot(found, shape)) == pytest.approx(np.linalg.norm(shape), rel=ROUNDING)
    assert found[np.argmax(abs(found))] == pytest.approx(abs(found).max(), rel=ROUNDING)


# --- Stabilization ------------------------------------------------------------------------------------------


def test_the_partner_is_the_nearest_pole_of_the_order_before():
    models = random_models(0)
    found = stabilize(models)
    for i in range(len(found)):
        before = np.flatnonzero(found.order == found.order[i] - 1)
        if not before.size:
            assert found.partner[i] == -1
            continue
        alike = am.mac(found.shape[i][:, None], found.shape[before].T)[0]
        distance = abs(found.pole[i] - found.pole[before]) / abs(found.pole[i]) + 1 - alike
        assert found.partner[i] == before[np.argmin(distance)]
        assert found.mac[i] == pytest.approx(alike[np.argmin(distance)], rel=ROUNDING)


def test_changes_are_relative_to_the_larger_value_and_unknown_in_the_first_order():
    models = [ModelPoles(p, pole([f], [z]), np.ones((1, 2), complex)) for p, f, z in ((2, 10.0, 0.02), (5, 8.0, 0.05))]
    found = stabilize(models)
    np.testing.assert_allclose(found.freq_change, [np.nan, 0.2], rtol=ROUNDING)
    np.testing.assert_allclose(found.damping_change, [np.nan, 0.6], rtol=ROUNDING)
    assert found.orders == (2, 5)
    assert found.order.tolist() == [2, 5]
    assert found.stable.tolist() == [False, False]


def test_without_any_criterion_every_pole_with_a_partner_is_stable():
    off = Criteria(freq_tolerance=None, damping_tolerance=None, mac=None, omac=None, damping_range=None)
    found = stabilize(random_models(1), off)
    np.testing.assert_array_equal(found.stable, found.order > 2)


@pytest.mark.parametrize(
    ("name", "limit", "meets"),
    [
        ("freq_tolerance", 0.02, lambda s: s.freq_change <= 0.02),
        ("damping_tolerance", 0.1, lambda s: s.damping_change <= 0.1),
        ("mac", 0.8, lambda s: s.mac >= 0.8),
        ("omac", 0.5, lambda s: s.omac >= 0.5),
        ("mpc", 0.5, lambda s: s.mpc >= 0.5),
        ("mpd_deg", 25.0, lambda s: s.mpd_deg <= 25.0),
        ("damping_range", (0.0, 0.5), lambda s: (s.damping_ratio > 0) & (s.damping_ratio < 0.5)),
        ("freq_range_hz", (20.0, 60.0), lambda s: (s.natural_freq_hz >= 20) & (s.natural_freq_hz <= 60)),
    ],
)
def test_a_criterion_alone_marks_exactly_the_poles_that_meet_it(name, limit, meets):
    off = Criteria(freq_tolerance=None, damping_tolerance=None, mac=None, omac=None, damping_range=None)
    found = stabilize(random_models(2), replace(off, **{name: limit}))
    expected = (found.partner >= 0) & meets(found)
    np.testing.assert_array_equal(found.stable, expected)
    assert 0 < expected.sum() < len(found)


def test_a_mode_that_comes_back_is_stable_and_a_growing_one_is_not():
    shapes = shapes_of(3, 2)
    found = stabilize([ModelPoles(p, pole([5.0, 9.0], [0.1, -0.01]), shapes) for p in (2, 3, 4)])
    assert found.stable.tolist() == [False, False, True, False, True, False]
    np.testing.assert_allclose(found.omac[2:], 1.0, rtol=ROUNDING)


def test_a_pole_without_a_shape_is_not_stable():
    shapes = shapes_of(4, 2)
    shapes[1] = np.nan
    found = stabilize([ModelPoles(p, pole([5.0, 9.0], [0.1, 0.1]), shapes) for p in (2, 3)])
    assert found.stable.tolist() == [False, False, True, False]
    assert np.isnan(found.mac[3])


def test_poles_at_zero_and_real_poles_pass_without_a_warning():
    poles = np.array([0.0, 1e-320, -5.0, -1e9, 3.0 + 1e-9j], complex)
    found = stabilize([ModelPoles(p, poles, shapes_of(5, 5)) for p in (1, 2)])
    assert not found.stable[:5].any()
    assert found.freq_change[5:].tolist() == [0.0] * 5


def test_orders_without_poles_are_bridged_by_none():
    empty = ModelPoles(3, np.zeros(0, complex), np.zeros((0, 6), complex))
    found = stabilize([ModelPoles(p, pole([5.0], [0.1]), shapes_of(6, 1)) if p != 3 else empty for p in (2, 3, 4)])
    assert len(found) == 2
    assert found.partner.tolist() == [-1, -1]


def test_standard_deviations_of_the_method_are_handed_on():
    shapes = shapes_of(7, 1)
    models = [
        ModelPoles(2, pole([5.0], [0.1]), shapes),
        ModelPoles(3, pole([5.0], [0.1]), shapes, freq_std_hz=np.array([0.01]), damping_std=np.array([0.002])),
    ]
    found = stabilize(models)
    np.testing.assert_array_equal(found.freq_std_hz, [np.nan, 0.01])
    np.testing.assert_array_equal(found.damping_std, [np.nan, 0.002])


def test_a_stabilization_cannot_be_changed():
    found = stabilize(random_models(3))
    with pytest.raises(ValueError, match="read-only"):
        found.stable[0] = True
    assert repr(found) == f"Stabilization(orders 2 to 11, {len(found)} poles, {found.stable.sum()} stable)"


# --- Bad input ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("models", "words"),
    [
        ([], "at least one model order"),
        ([ModelPoles(3, pole([1.0], [0.1]), np.ones((1, 2), complex))] * 2, "ascending model orders"),
        ([ModelPoles(3, pole([1.0], [0.1]), np.ones((2, 2), complex))], r"shapes \(1, 2\)"),
        ([ModelPoles(3, np.array([np.nan + 1j]), np.ones((1, 2), complex))], "pole 0 not finite"),
        (
            [ModelPoles(3, pole([1.0], [0.1]), np.ones((1, 2), complex), freq_std_hz=np.ones(2))],
            r"order 3.*freq_std_hz.*\(1,\)",
        ),
        (
            [ModelPoles(p, pole([1.0], [0.1]), np.ones((1, p), complex)) for p in (2, 3)],
            r"models\[1\] \(order 3\)",
        ),
    ],
)
def test_models_that_do_not_fit_each_other_are_refused(models, words):
    with pytest.raises(SignalError, match=words):
        stabilize(models)


@pytest.mark.parametrize(
    "limits",
    [
        {"freq_tolerance": -0.1},
        {"damping_tolerance": np.nan},
        {"mac": 1.2},
        {"omac": -0.1},
        {"mpc": 95},
        {"mpd_deg": 120},
        {"damping_range": (0.5, 0.1)},
        {"freq_range_hz": (5.0,)},
    ],
)
def test_a_limit_that_no_pole_or_every_pole_would_meet_is_refused(limits):
    with pytest.raises(SignalError, match=next(iter(limits))):
        Criteria(**limits)
