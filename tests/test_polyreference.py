"""Poles by pLSCF: complete and close for every known system, whatever side, unit or spacing they come in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armonic.errors import FrfError, SignalError
from armonic.frf_set import FrfSet
from armonic.identification.matrix_fraction import LOWER_GAP, Circle
from armonic.identification.polyreference import UPPER_GAP, polyreference_lscf
from measured_systems import COMPLEX, KUKA, LINES_HZ
from modal_starts import (
    measured,
    modes_of,
    nearest,
    same_poles,
    starts,
)

ORDERS = (1, 30)
ROUNDING = 1e-5
"""Poles of an order that has them all to some 1e-11, times the condition of the noisy normal equations, about 1e5."""


# --- Completeness -------------------------------------------------------------------------------------------


def test_nearly_all_poles_that_decay_are_modes():
    models = polyreference_lscf(KUKA.frfs(LINES_HZ, noise=0.01, seed=0), orders=(15, 40))
    decaying = [np.sum((m.poles.imag > 0) & (m.poles.real < 0) & (np.abs(m.poles) < 60 * np.pi)) for m in models]
    in_band = [np.sum(np.isfinite(m.shapes[:, 0])) for m in models]
    assert np.median(decaying) == len(KUKA.seen)
    assert min(in_band) >= 5 * len(KUKA.seen)


# --- Against other ways to the same poles -------------------------------------------------------------------


def poles_by_one_large_problem(frfs: FrfSet, p: int, weights=None):
    """All coefficients at once, by lstsq of Σ_o |w_o (H_o A − B_o)|² at real coefficients, and LAPACK's eigenvalues."""
    f, H = frfs.freq_hz, frfs.values
    angle = np.pi * (1 - UPPER_GAP) * f / f[-1]
    z = np.exp(1j * np.outer(angle, np.arange(p + 1)))
    lines, rows, m = H.shape
    left = np.zeros((rows, lines, m * p + rows * (p + 1)), complex)
    right = np.zeros((rows, lines, m), complex)
    for o in range(rows):
        # Rows count alike, as the method has it: each by its own RMS.
        size = np.sqrt((np.abs(H[:, o]) ** 2).mean())
        w = np.ones(lines) / size if weights is None else weights[:, o]
        left[o, :, : m * p] = (w[:, None, None] * z[:, 1:, None] * H[:, o, None, :]).reshape(lines, -1)
        left[o, :, m * p + o * (p + 1) : m * p + (o + 1) * (p + 1)] = -w[:, None] * z
        right[o] = -w[:, None] * H[:, o]
    left, right = left.reshape(rows * lines, -1), right.reshape(rows * lines, m)
    scale = np.linalg.norm(left, axis=0)
    solved = np.linalg.lstsq(
        np.vstack([left.real, left.imag]) / scale, np.vstack([right.real, right.imag]), rcond=None
    )[0]
    A = (solved / scale[:, None])[: m * p].reshape(p, m, m)
    companion = np.eye(m * p, k=-m)
    companion[:m] = -A.transpose(1, 0, 2).reshape(m, m * p)
    mu = 1 / np.linalg.eigvals(companion)
    return np.log(mu) * 2 * np.pi * f[-1] / (np.pi * (1 - UPPER_GAP))


@pytest.mark.parametrize("weighted", [False, True])
def test_the_reduced_equations_are_least_squares_of_all_coefficients_of_numerators_and_denominator(weighted):
    frfs = KUKA.frfs(LINES_HZ[9::10], noise=0.01, seed=1)
    weights = None
    if weighted:
        weights = np.random.default_rng(0).uniform(0.2, 1, (len(frfs.freq_hz), 3))
    given = None if weights is None else np.repeat(weights[:, :, None], 3, axis=2)
    for model in polyreference_lscf(frfs, orders=range(4, 13, 4), weights=given):
        expected = poles_by_one_large_problem(frfs, model.order, weights)
        assert len(model) >= 3 * model.order / 2
        for pole in model.poles:
            # Poles at half the sampling rate may stand on either side of it.
            partner = nearest(np.concatenate([expected, expected.conj()]), pole)
            assert abs(pole - partner) < ROUNDING * abs(pole)


# --- Invariances --------------------------------------------------------------------------------------------


def test_inputs_and_outputs_may_change_roles():
    frfs = measured(COMPLEX, noise=0.01).select(inputs=["tip.x", "tip.y"])
    turned = replace(
        frfs,
        values=frfs.values.transpose(0, 2, 1),
        outputs=frfs.inputs,
        inputs=frfs.outputs,
        coherence=None,
        averages=None,
        measured=frfs.measured.T,
    )
    models = polyreference_lscf(frfs, orders=ORDERS)
    same_poles(polyreference_lscf(turned, orders=ORDERS), models, 1e-12)
    assert {model.shapes.shape[1] for model in models} == {3}
    assert {model.shapes.shape[1] for model in polyreference_lscf(frfs, orders=ORDERS, references="outputs")} == {2}


def test_units_of_responses_and_forces_change_no_mode():
    frfs = measured(KUKA, noise=0.01)
    units = np.array([1.0, 1e3, 1e-6])[:, None] * np.array([1.0, 9.81, 1e-3])
    models = [
        polyreference_lscf(replace(frfs, values=frfs.values * unit, coherence=None), orders=ORDERS)
        for unit in (np.ones((3, 3)), units)
    ]
    modes = [modes_of(model) for model in models]
    assert [len(found) for found in modes] == [4, 4]
    for a, b in zip(*modes, strict=True):
        # Rows count by their RMS, to which the references contribute by their units; noise has a slightly other weight.
        assert abs(a.pole - b.pole) < 1e-3 * abs(a.pole)


def test_lines_of_zero_weight_are_as_good_as_absent():
    frfs = KUKA.frfs(LINES_HZ[3::4], noise=0.01, seed=2)
    bad = np.zeros(len(frfs.freq_hz), bool)
    bad[40:60] = bad[210:215] = True  # at 2.4 to 3.6 and 12.6 to 12.9 Hz
    spoiled = frfs.values.copy()
    spoiled[bad] = 1e3
    ones = np.where(bad, 0.0, 1.0)[:, None, None]
    weighted = polyreference_lscf(replace(frfs, values=spoiled, coherence=None), orders=ORDERS, weights=ones)
    absent = frfs.lines(np.flatnonzero(~bad))
    modes = modes_of(weighted), modes_of(polyreference_lscf(absent, orders=ORDERS))
    assert len(modes[0]) == len(modes[1]) == 4
    for a, b in zip(*modes, strict=True):
        # The spoiled lines enter only the share by which rows are scaled: less than the scatter of the noise.
        assert abs(a.pole - b.pole) < 1e-3 * abs(a.pole)


def test_weights_from_known_deviations_lower_the_error_that_noise_of_unequal_size_makes():
    rng = np.random.default_rng(0)
    exact = KUKA.frfs(LINES_HZ[3::4])
    sigma = np.where((exact.freq_hz > 12) & (exact.freq_hz < 18), 0.3, 0.003)[:, None, None]
    sigma = sigma * np.sqrt((np.abs(exact.values) ** 2).mean(axis=0))
    errors = []
    for _ in range(5):
        noise = (
            sigma * (rng.standard_normal(exact.values.shape) + 1j * rng.standard_normal(exact.values.shape)) / 2**0.5
        )
        noisy = replace(exact, values=exact.values + noise)
        pair = [polyreference_lscf(noisy, orders=(10, 30), weights=w) for w in (None, 1 / sigma)]
        errors.append(
            [np.mean([abs(nearest(m.poles, p) / p - 1) for m in models for p in KUKA.seen_poles]) for models in pair]
        )
    plain, weighted = np.mean(errors, axis=0)
    assert weighted < plain / 2


def test_a_set_with_pairs_missing_gives_all_modes_from_the_others():
    frfs = measured(KUKA, noise=0.01)
    measured_pairs = np.array([[True, True, False], [True, True, True], [False, True, True]])
    part = FrfSet(frfs.freq_hz, frfs.values, frfs.kind, frfs.outputs, frfs.inputs, measured=measured_pairs)
    models = polyreference_lscf(part, orders=ORDERS)
    assert {model.shapes.shape[1] for model in models} == {7}
    assert starts(modes_of(models), KUKA).complete
    with pytest.raises(FrfError, match=r"no response tip.x to tip.z"):
        polyreference_lscf(part, orders=ORDERS, references="inputs")


def test_shapes_of_one_reference_are_those_of_the_modes():
    rng = np.random.default_rng(5)
    shapes = rng.uniform(-1, 1, (4, 12)) * np.exp(1j * rng.uniform(-0.3, 0.3, (4, 12)))
    labels = tuple(f"p{i}.z" for i in range(12))
    system = replace(KUKA, shapes=shapes, outputs=labels, inputs=labels)
    one = system.frfs(LINES_HZ[3::4], noise=0.01, seed=0).select(inputs="p3.z")
    modes = modes_of(polyreference_lscf(one, orders=ORDERS))
    assert starts(modes, system).complete
    for mode, shape in zip(modes, shapes, strict=True):
        # The bias of single orders mixes some percent of a mode 1 Hz away into it; 1 − MAC is the square of that.
        assert abs(np.vdot(mode.shape, shape)) ** 2 / np.vdot(shape, shape).real > 0.99


def test_a_degree_of_freedom_that_does_not_respond_is_no_obstacle():
    frfs = measured(KUKA, noise=0.01)
    values = frfs.values.copy()
    values[:, 2] = values[:, :, 1] = 0
    silent = replace(frfs, values=values, coherence=None)
    assert starts(modes_of(polyreference_lscf(silent, orders=ORDERS)), KUKA).complete


def test_shapes_are_given_in_the_band_only_and_orders_as_asked_for():
    models = polyreference_lscf(measured(KUKA, noise=0.01), orders=range(4, 20, 5), band_hz=(8.0, 13.0))
    assert [model.order for model in models] == [4, 9, 14, 19]
    for model in models:
        freq = np.abs(model.poles) / 2 / np.pi
        inside = (freq >= 8) & (freq <= 13)
        assert np.array_equal(np.isfinite(model.shapes).all(axis=1), inside)
        assert np.all(model.poles.imag >= 0)
        assert np.all(np.diff(np.abs(model.poles)) >= 0)


@pytest.mark.parametrize(("low", "high"), [(0.0, 30.0), (2.0, 30.0), (8.0, 13.0), (99.0, 100.0)])
def test_lines_lie_on_the_upper_half_circle_and_a_pole_comes_back_from_there(low, high):
    circle = Circle.of_lines(low, high, UPPER_GAP)
    ends = circle.angles(np.array([low, high]))
    assert 0 <= ends[0] <= LOWER_GAP * np.pi + 1e-12
    assert ends[1] == pytest.approx((1 - UPPER_GAP) * np.pi)
    pole = 2 * np.pi * (0.3 * low + 0.7 * high) * (-0.01 + 1j)
    z = np.exp(1j * circle.offset + circle.slope * pole)
    assert circle.poles(np.array([z]))[0] == pytest.approx(pole, rel=1e-12)


# --- What cannot be done ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "error", "text"),
    [
        ({"orders": (1, 2000)}, SignalError, "at most"),
        ({"orders": (0, 5)}, SignalError, "orders"),
        ({"band_hz": (20.0, 10.0)}, SignalError, "band_hz"),
        ({"band_hz": (40.0, 50.0)}, FrfError, "no line from 40 to 50 Hz"),
        ({"band_hz": (10.0, 10.04)}, FrfError, "at least 4 lines"),
        ({"weights": np.ones((5, 3, 3))}, FrfError, "shape"),
        ({"weights": -1.0}, FrfError, "negative"),
        ({"weights": np.nan}, FrfError, "not finite"),
        ({"weights": "much"}, FrfError, "weights"),
        ({"references": "hammer"}, SignalError, "references"),
    ],
)
def test_what_makes_no_sense_is_refused(changes, error, text):
    with pytest.raises(error, match=text):
        polyreference_lscf(KUKA.frfs(LINES_HZ), **({"orders": ORDERS} | changes))


def test_responses_that_are_zero_are_refused():
    silent = FrfSet(LINES_HZ, np.zeros((2000, 3, 3)), "accelerance", KUKA.outputs, KUKA.inputs)
    with pytest.raises(FrfError, match="zero at all lines"):
        polyreference_lscf(silent, orders=ORDERS)
