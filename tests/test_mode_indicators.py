"""Mode-indicator functions against closed forms, generalized eigenvalues, and modes that are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import eigh

from armonic.frf_set import FrfSet
from armonic.identification.mode_indicators import (
    complex_mode_indicator,
    multivariate_mode_indicator,
    normal_mode_indicator,
)
from measured_systems import COMPLEX, KUKA, LINES_HZ, KnownSystem

FINE_HZ = np.arange(500, 2600) / 100
ROUNDING = 1e-9  # products of numbers of order one, over a smallest eigenvalue of some thousandths


def dips(curve, below):
    """Lines at the local minima of a curve that lie below a level."""
    inner = (curve[1:-1] < curve[:-2]) & (curve[1:-1] <= curve[2:]) & (curve[1:-1] < below)
    return FINE_HZ[1:-1][inner]


def test_cmif_squared_has_the_eigenvalues_of_the_responses_times_their_conjugates():
    frfs = COMPLEX.frfs(LINES_HZ[::50])
    H = frfs.values
    expected = np.linalg.eigvalsh(H.conj().transpose(0, 2, 1) @ H)[:, ::-1]
    found = complex_mode_indicator(frfs)
    assert found.shape == (40, 3)
    # The squares hold the smaller values only to rounding of the largest.
    assert np.abs(found**2 - expected).max(axis=1) == pytest.approx(0, abs=1e-12 * expected.max())
    assert np.all(np.diff(found, axis=1) <= 0)


def test_peaks_of_the_cmif_are_the_modes():
    first = complex_mode_indicator(KUKA.frfs(FINE_HZ))[:, 0]
    inner = (first[1:-1] > first[:-2]) & (first[1:-1] > first[2:])
    # Off by ζ² and by the tails of the others: some thousandths.
    np.testing.assert_allclose(FINE_HZ[1:-1][inner], KUKA.freq_hz, rtol=5e-3)


@pytest.mark.parametrize("kind", ["receptance", "accelerance"])
def test_mmif_solves_the_eigenvalue_problem_of_in_phase_energy(kind):
    frfs = COMPLEX.frfs(LINES_HZ[100::100], kind=kind).select(inputs=["tip.x", "tip.z"])
    found = multivariate_mode_indicator(frfs)
    assert found.shape == (len(frfs.freq_hz), 2)
    for H, values in zip(frfs.values, found, strict=True):
        real, imag = H.real.T @ H.real, H.imag.T @ H.imag
        size = np.trace(real + imag)
        expected = eigh(real / size, (real + imag) / size, eigvals_only=True)
        np.testing.assert_allclose(values, expected, atol=1e-6)  # the quotient of two squares, near one


def test_mmif_of_fewer_forces_than_outputs_dips_where_the_modes_are_and_for_two_in_one_place_twice():
    two = KUKA.frfs(FINE_HZ).select(inputs=["tip.x", "tip.y"])
    np.testing.assert_allclose(dips(multivariate_mode_indicator(two)[:, 0], 0.2), KUKA.freq_hz, rtol=5e-3)
    twice = KnownSystem((12.0, 12.0), (0.01, 0.01), np.eye(2, 3), (0, 1))
    both = multivariate_mode_indicator(twice.frfs(FINE_HZ).select(inputs=["tip.x", "tip.y"]))
    assert both[np.argmin(np.abs(FINE_HZ - 12.0))] == pytest.approx([0, 0], abs=1e-9)


def test_with_as_many_forces_as_outputs_every_mode_still_dips():
    values = multivariate_mode_indicator(KUKA.frfs(KUKA.freq_hz))
    # Of the square of what damping shifts by, and of the tails of the others.
    assert values[:, 0].max() < 1e-3
    assert values[:, 1].min() > 0.9


def test_normal_mif_of_one_mode_is_the_cosine_of_its_phase():
    freq, ratio = 12.0, 0.02
    one = KnownSystem((freq,), (ratio,), np.array([[1.0, -0.4, 0.7]]), (0,))
    r = FINE_HZ / freq
    expected = np.abs(1 - r**2) / np.hypot(1 - r**2, 2 * ratio * r)
    for kind in ("receptance", "mobility", "accelerance"):
        frfs = one.frfs(FINE_HZ, kind=kind)
        found = normal_mode_indicator(frfs)
        assert found.shape == (len(FINE_HZ), 3)
        np.testing.assert_allclose(found, np.repeat(expected[:, None], 3, axis=1), atol=ROUNDING)
        # Of a single mode, the multivariate one is its square: the energy.
        single = multivariate_mode_indicator(frfs.select(inputs="tip.x"))
        np.testing.assert_allclose(single[:, 0], expected**2, atol=ROUNDING)


def test_indicators_of_phase_do_not_depend_on_the_kind():
    frfs = COMPLEX.frfs(LINES_HZ[40:])
    for indicator in (multivariate_mode_indicator, normal_mode_indicator):
        expected = indicator(frfs)
        assert expected.min() >= 0
        assert expected.max() <= 1
        for kind in ("receptance", "mobility"):
            np.testing.assert_allclose(indicator(frfs.to(kind)), expected, atol=ROUNDING)


def test_mmif_takes_the_smaller_side_for_the_forces():
    frfs = COMPLEX.frfs(LINES_HZ[40:100]).select(inputs="tip.x")
    turned = FrfSet(frfs.freq_hz, frfs.values.transpose(0, 2, 1), frfs.kind, frfs.inputs, frfs.outputs)
    np.testing.assert_array_equal(multivariate_mode_indicator(turned), multivariate_mode_indicator(frfs))


def test_forces_without_response_and_lines_of_zeros_show_no_mode():
    frfs = KUKA.frfs(FINE_HZ)
    values = frfs.values.copy()
    values[:, :, 2] = 0
    values[100] = 0
    silent = replace(frfs, values=values)
    mmif, mif = multivariate_mode_indicator(silent), normal_mode_indicator(silent)
    assert np.all(mmif[:, 2] == 1)
    assert np.all(mif[:, 2] == 1)
    assert np.all(mmif[100] == 1)
    assert np.all(complex_mode_indicator(silent)[100] == 0)
    whole = multivariate_mode_indicator(frfs.select(inputs=["tip.x", "tip.y"]))
    lines = np.arange(len(FINE_HZ)) != 100
    np.testing.assert_allclose(mmif[lines, :2], whole[lines], atol=1e-9)
