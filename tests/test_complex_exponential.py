"""Poles by LSCE: exact from exponentials, complete and close from the responses of every known system."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armonic.errors import FrfError, SignalError
from armonic.frf_set import FrfSet
from armonic.identification.complex_exponential import complex_exponential, exponentials_of
from armonic.identification.impulse_responses import SKIPPED, impulse_responses
from armonic.identification.polyreference import polyreference_lscf
from armonic.identification.references import referenced
from measured_systems import COMPLEX, KUKA, LINES_HZ
from modal_starts import measured, modes_of, nearest, same_poles, starts

ORDERS = (1, 30)
EXACT = 1e-8
"""Relative error that poles of exponentials without noise may have."""


def exponentials(poles, left, right, rate, count):
    """Σ 2 Re ψ lᵀ e^(λ k / rate), (count, rows, m), in closed form."""
    times = np.arange(count) / rate
    residues = left[:, :, None] * right[:, None, :]
    return 2 * np.einsum("rk,rom->kom", np.exp(poles[:, None] * times), residues).real


def random_motion(seed, modes, rows, m):
    rng = np.random.default_rng(seed)
    freq = np.sort(rng.uniform(2, 40, modes))
    while modes > 1 and np.diff(freq).min() < 0.5:
        freq = np.sort(rng.uniform(2, 40, modes))
    ratio = rng.uniform(0.002, 0.05, modes)
    poles = 2 * np.pi * freq * (-ratio + 1j * np.sqrt(1 - ratio**2))
    left, right = (rng.uniform(0.3, 1, (modes, n)) * np.exp(2j * np.pi * rng.random((modes, n))) for n in (rows, m))
    return poles, left, right


# --- Exponentials -------------------------------------------------------------------------------------------


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 4), st.integers(1, 4), st.integers(1, 3))
def test_sums_of_exponentials_give_their_poles_exactly_at_every_order_that_can_hold_them(seed, modes, rows, m):
    poles, left, right = random_motion(seed, modes, rows, m)
    samples = exponentials(poles, left, right, 100.0, 400)
    # The least one holds them with one reference already; the others hold more than there is.
    for model in exponentials_of(samples, 100.0, orders=range(2 * modes, 4 * modes + 1)):
        for pole in poles:
            assert abs(nearest(model.poles, pole) / pole - 1) < EXACT


def test_exponentials_have_their_shapes_and_those_added_by_a_high_order_grow():
    poles, left, right = random_motion(1, 3, 5, 2)
    for model in exponentials_of(exponentials(poles, left, right, 100.0, 600), 100.0, orders=(6, 20)):
        decaying = (model.poles.real < 0) & (model.poles.imag > 0)
        assert decaying.sum() == 3
        for pole, shape in zip(poles, left, strict=True):
            found = model.shapes[np.argmin(np.abs(model.poles - pole))]
            assert abs(np.vdot(found, shape)) ** 2 / np.vdot(shape, shape).real == pytest.approx(1, abs=1e-10)


def test_impulse_responses_are_those_of_the_modes():
    frfs = KUKA.frfs(LINES_HZ)
    laid = referenced(frfs, None, None)
    found = impulse_responses(laid)
    assert found.circle.offset == pytest.approx(0, abs=1e-12)
    step = found.circle.slope
    assert step == pytest.approx(1 / 60)
    period = 1 / LINES_HZ[0]
    # Each mode with all its repetitions, and the mean [¼ ½ ¼] of neighbouring samples that the taper makes.
    times = step * (SKIPPED + np.arange(len(found.samples)))
    expected = np.zeros(found.samples.shape)
    for pole, residue in zip(KUKA.poles, KUKA.residues, strict=True):
        motion = np.exp(pole * times) / (1 - np.exp(pole * period)) * np.cosh(pole * step / 2) ** 2
        expected += 2 * (motion[:, None, None] * residue * pole**2).real
    given_scale = found.samples * laid.scale[:, None] / step
    # What is cut off above 30 Hz rings about t = 0 and falls by its square and more.
    late = times > 1.0
    assert np.abs(given_scale[late] - expected[late]).max() < 1e-4 * np.abs(expected).max()


# --- Frequency responses ------------------------------------------------------------------------------------


@pytest.mark.parametrize("first", [0.0, 0.0075])
def test_lines_may_begin_at_zero_or_between_two_multiples_of_their_spacing(first):
    lines = first + 0.015 * np.arange(2000)
    found = starts(modes_of(complex_exponential(KUKA.frfs(lines, noise=0.01), orders=ORDERS)), KUKA)
    assert found.complete
    assert found.false == 0


def test_it_finds_the_modes_that_plscf_finds_in_the_same_responses():
    frfs = measured(COMPLEX, noise=0.01, seed=3)
    pair = [modes_of(method(frfs, orders=ORDERS)) for method in (complex_exponential, polyreference_lscf)]
    assert [len(modes) for modes in pair] == [4, 4]
    for a, b in zip(*pair, strict=True):
        # Each has a bias of some parts in ten thousand of its own.
        assert abs(a.pole - b.pole) < 1e-3 * abs(a.pole)
        assert abs(np.vdot(a.shape, b.shape)) > 0.999


def test_inputs_and_outputs_may_change_roles():
    frfs = measured(COMPLEX, noise=0.01).select(inputs=["tip.x", "tip.y"])
    turned = FrfSet(frfs.freq_hz, frfs.values.transpose(0, 2, 1), frfs.kind, frfs.inputs, frfs.outputs)
    models = complex_exponential(frfs, orders=ORDERS)
    same_poles(complex_exponential(turned, orders=ORDERS), models, 1e-12)
    assert {model.shapes.shape[1] for model in models} == {3}


def test_a_set_with_pairs_missing_gives_all_modes_from_the_others():
    frfs = measured(KUKA, noise=0.01)
    pairs = np.array([[True, True, False], [True, True, True], [False, True, True]])
    part = FrfSet(frfs.freq_hz, frfs.values, frfs.kind, frfs.outputs, frfs.inputs, measured=pairs)
    assert starts(modes_of(complex_exponential(part, orders=ORDERS)), KUKA).complete


# --- What cannot be done ------------------------------------------------------------------------------------


def test_lines_without_one_spacing_are_refused_and_a_band_where_they_have_one_is_taken():
    lines = np.r_[np.arange(1, 100) * 0.05, 5 + np.arange(0, 1000) * 0.025]
    frfs = KUKA.frfs(lines, noise=0.01)
    with pytest.raises(FrfError, match=r"lines 0\.025 to 0\.05 Hz apart, expected evenly spaced") as caught:
        complex_exponential(frfs, orders=ORDERS)
    assert "pLSCF" in str(caught.value)
    assert starts(modes_of(complex_exponential(frfs, orders=ORDERS, band_hz=(5, 30))), KUKA).complete


@pytest.mark.parametrize(
    ("changes", "error", "text"),
    [
        ({"orders": (1, 2000)}, SignalError, "at most"),
        ({"orders": (3, 1)}, SignalError, "orders"),
        ({"band_hz": (20.0, 10.0)}, SignalError, "band_hz"),
        ({"band_hz": (40.0, 50.0)}, FrfError, "no line from 40 to 50 Hz"),
        ({"references": "hammer"}, SignalError, "references"),
    ],
)
def test_what_makes_no_sense_is_refused(changes, error, text):
    with pytest.raises(error, match=text):
        complex_exponential(KUKA.frfs(LINES_HZ), **({"orders": ORDERS} | changes))


@pytest.mark.parametrize(
    ("samples", "rate", "text"),
    [
        (np.ones((50, 3)), 100.0, r"shape \(50, 3\)"),
        (np.zeros((50, 3, 2)), 100.0, "only zeros"),
        (np.full((50, 3, 2), np.nan), 100.0, "finite"),
        (np.ones((50, 3, 2), complex), 100.0, "complex"),
        (np.ones((50, 3, 2)), 0.0, "sample_rate_hz"),
        (np.ones((4, 3, 2)), 100.0, "order 5 for 4 samples"),
    ],
)
def test_samples_that_make_no_sense_are_refused(samples, rate, text):
    with pytest.raises(SignalError, match=text):
        exponentials_of(samples, rate, orders=(1, 5))
