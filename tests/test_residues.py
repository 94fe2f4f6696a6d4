"""Residues at known poles, and what a modal model makes of them, against closed forms and plain least squares."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armonic.errors import FrfError, SignalError
from armonic.frf_set import FrfSet
from armonic.identification.modal_model import ModalModel, rank_one_factors
from armonic.identification.residues import fit_residues
from measured_systems import BAND, BATTERY, COMPLEX, KUKA, LINES_HZ, OUT_OF_BAND

KINDS = ("receptance", "mobility", "accelerance")
EXACT = 1e-8  # what the issue asks of noise-free data
ROUNDING = 1e-11  # sums of a few hundred products


def outside(system):
    return np.delete(system.poles, system.seen)


def away(found, expected):
    return float(np.abs(found - expected).max() / np.abs(expected).max())


def model_of(system, **more):
    return ModalModel(system.poles, system.residues, system.outputs, system.inputs, **more)


# --- Fitting ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("decay_rate", [0.0, 2.0])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", BATTERY)
def test_residues_of_every_known_system_come_back_from_its_responses(name, kind, decay_rate):
    system = BATTERY[name]
    frfs = system.frfs(LINES_HZ, kind=kind, decay_rate=decay_rate).band(*BAND)
    model = fit_residues(frfs, system.seen_poles, background=outside(system) if outside(system).size else None)
    assert away(model.residues, system.residues[list(system.seen)]) < EXACT
    # What is not there is not found: residuals against the stiffness of the system.
    assert np.abs(model.upper).max() < EXACT * np.abs(system.residues).max() / abs(system.poles).min()


def test_lower_and_upper_residuals_of_free_and_stiff_motion_come_back():
    s = 2j * np.pi * LINES_HZ
    rng = np.random.default_rng(0)
    lower, upper = rng.normal(size=(3, 3)), 1e-4 * rng.normal(size=(3, 3))
    values = KUKA.frfs(LINES_HZ).values + lower + upper * (s**2)[:, None, None]
    model = fit_residues(FrfSet(LINES_HZ, values, "accelerance", KUKA.outputs, KUKA.inputs), KUKA.poles)
    assert away(model.lower, lower) < EXACT
    assert away(model.upper, upper) < EXACT
    assert away(model.residues, KUKA.residues) < EXACT


@pytest.mark.parametrize("weighted", [False, True])
def test_noisy_residues_are_those_of_plain_least_squares(weighted):
    frfs = KUKA.frfs(LINES_HZ[::10], noise=0.1, seed=1)
    weights = np.random.default_rng(2).uniform(0.1, 10, frfs.values.shape) if weighted else None
    model = fit_residues(frfs, KUKA.poles, weights=weights)
    s = frfs.s[:, None]
    near, far = 1 / (s - KUKA.poles), 1 / (s - KUKA.poles.conj())
    A = np.hstack([near + far, 1j * (near - far), s**-2, np.ones_like(s)]) * s**2
    for o in range(3):
        for i in range(3):
            w = np.ones(len(s)) if weights is None else weights[:, o, i]
            rows = np.concatenate([(A * w[:, None]).real, (A * w[:, None]).imag])
            right = np.concatenate([(frfs.values[:, o, i] * w).real, (frfs.values[:, o, i] * w).imag])
            size = np.linalg.norm(rows, axis=0)
            c = np.linalg.lstsq(rows / size, right)[0] / size
            # The normal matrix of each pair squares the spread of the weights, a hundred.
            np.testing.assert_allclose(model.residues[:, o, i], c[:4] + 1j * c[4:8], rtol=1e-9)
            np.testing.assert_allclose([model.lower[o, i], model.upper[o, i]], c[8:], rtol=1e-8)


def test_values_of_weight_zero_do_not_count():
    frfs = KUKA.frfs(LINES_HZ)
    spoiled, weights = frfs.values.copy(), np.ones(frfs.values.shape)
    spoiled[100:140, 0, 1] = 1e3
    weights[100:140, 0, 1] = 0
    model = fit_residues(replace(frfs, values=spoiled), KUKA.poles, weights=weights)
    assert away(model.residues, KUKA.residues) < EXACT


def test_residues_of_real_modes_are_imaginary_and_those_of_proportional_damping_exact():
    model = fit_residues(KUKA.frfs(LINES_HZ, noise=0.05), KUKA.poles, real=True)
    assert np.abs(model.residues.real).max() == 0
    assert away(fit_residues(KUKA.frfs(LINES_HZ), KUKA.poles, real=True).residues, KUKA.residues) < EXACT


@pytest.mark.parametrize("kind", KINDS)
def test_a_line_at_zero_hertz_neither_helps_nor_harms(kind):
    lines = np.arange(2000) * 0.015
    model = fit_residues(KUKA.frfs(lines, kind=kind), KUKA.poles)
    assert away(model.residues, KUKA.residues) < EXACT


def test_pairs_that_were_not_measured_stay_out():
    measured = np.array([[1, 1, 0], [0, 1, 1], [1, 0, 1]], bool)
    frfs = replace(KUKA.frfs(LINES_HZ), measured=measured)
    model = fit_residues(frfs, KUKA.poles)
    np.testing.assert_array_equal(model.measured, measured)
    assert away(model.residues, KUKA.residues * measured) < EXACT
    assert not model.residues[:, ~measured].any()


@pytest.mark.parametrize(
    ("poles", "background", "words"),
    [
        ([-1.0, -1 + 60j], None, "Im λ > 0"),
        ([-1 + 60j, -1 + 60j], None, "twice"),
        ([-1 + 60j], [-1 + 60j], "twice"),
        ([[-1 + 60j]], None, "shape"),
        ([np.nan], None, "nan"),
        (["fast"], None, "poles"),
    ],
)
def test_poles_that_are_none_are_refused(poles, background, words):
    with pytest.raises(SignalError, match=words):
        fit_residues(KUKA.frfs(LINES_HZ), poles, background=background)


def test_more_residues_than_lines_and_odd_weights_are_refused():
    frfs = KUKA.frfs(LINES_HZ)
    with pytest.raises(FrfError, match="more lines"):
        fit_residues(frfs.lines([10, 500, 700]), KUKA.poles)
    for weights, words in ((np.ones(7), "weights"), (-1.0, "zero or more"), (0.0, "zero at every line")):
        with pytest.raises(FrfError, match=words):
            fit_residues(frfs, KUKA.poles, weights=weights)
    few = np.zeros(frfs.values.shape)
    few[:, 0, 0], few[:3] = 1, 1
    with pytest.raises(FrfError, match="more lines"):
        fit_residues(frfs, KUKA.poles, weights=few)


# --- Synthesis ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_synthesized_responses_are_those_of_the_system_without_its_window(kind):
    windowed = OUT_OF_BAND.frfs(LINES_HZ, kind=kind, decay_rate=2.0).band(*BAND)
    found = fit_residues(windowed, OUT_OF_BAND.seen_poles, background=outside(OUT_OF_BAND)).frfs(windowed.freq_hz, kind)
    assert found.decay_rate == 0
    assert away(found.values, OUT_OF_BAND.frfs(windowed.freq_hz, kind=kind).values) < EXACT


def test_receptance_is_the_sum_of_its_modes_and_what_lies_outside():
    model = model_of(COMPLEX, lower=np.eye(3), upper=np.full((3, 3), 1e-6))
    s = 2j * np.pi * np.array([3.0, 10.2]) + 0.5
    alone = sum(model.receptance(s, residuals=False, modes=[r]) for r in range(4))
    np.testing.assert_allclose(alone, COMPLEX.frfs([3.0, 10.2], kind="receptance", decay_rate=0.5).values, rtol=1e-12)
    rest = np.eye(3) / s[:, None, None] ** 2 + 1e-6
    np.testing.assert_allclose(model.receptance(s), alone + rest, rtol=ROUNDING)


def test_accelerance_at_zero_hertz_is_that_of_the_rigid_motion_and_receptance_has_none():
    model = model_of(KUKA, lower=np.eye(3))
    np.testing.assert_allclose(model.frfs([0.0, 1.0]).values[0], np.eye(3))
    with pytest.raises(FrfError, match="0 Hz"):
        model.frfs([0.0, 1.0], "receptance")


def test_a_model_that_does_not_fit_itself_is_refused():
    for more, words in (
        ({"lower": np.eye(2)}, "lower"),
        ({"upper": np.full((3, 3), np.nan)}, "upper"),
        ({"measured": [True]}, "measured"),
        ({"background_poles": [-1 + 3j]}, None),
    ):
        if words is None:  # a pole without residues has none
            assert not model_of(KUKA, **more).background_residues.any()
        else:
            with pytest.raises(FrfError, match=words):
                model_of(KUKA, **more)
    with pytest.raises(FrfError, match="different"):
        ModalModel(KUKA.poles, KUKA.residues, ("a.x", "a.x", "a.y"), KUKA.inputs)
    with pytest.raises(FrfError, match="kind"):
        model_of(KUKA).frfs([1.0], "compliance")
    with pytest.raises(FrfError, match="modes"):
        model_of(KUKA).receptance([1j], modes=[4])


# --- Reciprocity --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("how", ["average", "upper", "lower"])
def test_a_symmetrized_model_has_symmetric_responses_from_the_chosen_side(how):
    rng = np.random.default_rng(0)
    skew = KUKA.residues * (1 + 0.1 * rng.normal(size=KUKA.residues.shape))
    model = ModalModel(KUKA.poles, skew, KUKA.outputs, KUKA.inputs, lower=rng.normal(size=(3, 3)))
    values, made = model.frfs([5.0, 10.0]).values, model.symmetrized(how).frfs([5.0, 10.0]).values
    flipped = values.swapaxes(1, 2)
    keep = np.triu(np.ones((3, 3), bool)) if how == "upper" else np.tril(np.ones((3, 3), bool))
    expected = (values + flipped) / 2 if how == "average" else np.where(keep, values, flipped)
    np.testing.assert_allclose(made, expected, rtol=ROUNDING)


@pytest.mark.parametrize("how", ["average", "upper", "lower"])
def test_what_was_measured_one_way_only_is_mirrored(how):
    measured = np.array([[1, 1, 0], [0, 1, 0], [1, 0, 0]], bool)
    model = model_of(KUKA, measured=measured).symmetrized(how)
    np.testing.assert_array_equal(model.measured, measured | measured.T)
    np.testing.assert_allclose(model.residues, KUKA.residues * model.measured, rtol=1e-14)


def test_pairs_without_a_mirror_stay_as_they_are():
    residues = KUKA.residues.copy()
    residues[:, 0, 1] *= 3
    model = ModalModel(KUKA.poles, residues, ("tip.x", "tip.y", "tip.z"), ("tip.y", "tip.x", "base.x"))
    made = model.symmetrized().residues
    np.testing.assert_array_equal(made[:, :, 2], residues[:, :, 2])
    np.testing.assert_array_equal(made[:, 2], residues[:, 2])
    # tip.x to a force at tip.y is entry 0, 0; tip.y to one at tip.x is entry 1, 1.
    np.testing.assert_allclose(made[:, 0, 0], (residues[:, 0, 0] + residues[:, 1, 1]) / 2)
    np.testing.assert_array_equal(made[:, 0, 0], made[:, 1, 1])
    with pytest.raises(FrfError, match="how"):
        model.symmetrized("left")


# --- Rank one -----------------------------------------------------------------------------------------------


def test_the_nearest_matrix_of_rank_one_is_that_of_the_first_singular_value():
    rng = np.random.default_rng(3)
    noisy = COMPLEX.residues + 1e-4 * rng.normal(size=COMPLEX.residues.shape)
    made = ModalModel(COMPLEX.poles, noisy, COMPLEX.outputs, COMPLEX.inputs).rank_one().residues
    for matrix, found in zip(noisy, made, strict=True):
        U, sizes, Vh = np.linalg.svd(matrix)
        np.testing.assert_allclose(found, sizes[0] * np.outer(U[:, 0], Vh[0]), rtol=ROUNDING, atol=1e-15)


@pytest.mark.parametrize("gaps", [[(0, 0)], [(0, 1), (1, 2), (2, 0)], [(0, 1), (0, 2), (1, 2), (2, 1)]])
def test_factors_of_rank_one_are_exact_though_pairs_are_missing(gaps):
    rng = np.random.default_rng(4)
    x, y = rng.normal(size=(2, 5, 3)) + 1j * rng.normal(size=(2, 5, 3))
    measured = np.ones((3, 3), bool)
    measured[tuple(np.array(gaps).T)] = False
    A = x[:, :, None] * y[:, None, :]
    shapes, factors = rank_one_factors(np.where(measured, A, 0), measured)
    np.testing.assert_allclose(shapes[:, :, None] * factors[:, None, :], A, rtol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(shapes, axis=1), 1)
