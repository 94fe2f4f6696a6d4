"""Scale and complexity of mode shapes from residues of known scale, over every layout of hammer and sensor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armonic.identification.modal_model import ModalModel
from armonic.identification.modal_scaling import modal_scaling
from armonic.identification.refinement import refine
from armonic.identification.shape_criteria import mac_table
from measured_systems import COMPLEX, KUKA, LINES_HZ

EXACT = 1e-10  # factors of small matrices of rank one


def model_of(system, **more):
    return ModalModel(system.poles, system.residues, system.outputs, system.inputs, **more)


def layout(poles, shapes, outputs, inputs, labels="abcdefgh"):
    """Residues R = φφᵀ / (2i Im λ) of some rows and columns of shapes of unit modal mass."""
    rows, columns = ([labels.index(x) for x in side] for side in (outputs, inputs))
    R = shapes[:, rows][:, :, None] * shapes[:, columns][:, None, :] / (2j * poles.imag)[:, None, None]
    return ModalModel(poles, R, tuple(f"{x}.x" for x in outputs), tuple(f"{x}.x" for x in inputs))


def alike(found, expected, tolerance=EXACT):
    """Whether shapes are the same but for their signs."""
    sign = np.sign(np.sum((found * expected.conj()).real, axis=1))[:, None]
    np.testing.assert_allclose(found * sign, expected, rtol=0, atol=tolerance * np.abs(expected).max())


def random_shapes(seed, modes, points):
    rng = np.random.default_rng(seed)
    return rng.uniform(0.3, 1, (modes, points)) * rng.choice([-1, 1], (modes, points))


# --- Scale --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("system", [KUKA, COMPLEX], ids=["real", "complex"])
def test_shapes_of_unit_modal_mass_are_those_that_made_the_residues(system):
    scaling = modal_scaling(model_of(system))
    assert scaling.scaled.all()
    alike(scaling.unit_modal_mass(), system.shapes)


@pytest.mark.parametrize("system", [KUKA, COMPLEX], ids=["real", "complex"])
def test_shapes_of_unit_modal_a_square_to_the_residues(system):
    psi = modal_scaling(model_of(system)).unit_modal_a()
    expected = system.residues
    np.testing.assert_allclose(psi[:, :, None] * psi[:, None, :], expected, atol=EXACT * np.abs(expected).max())


def test_modal_a_and_mass_are_those_of_the_shapes_of_unit_length():
    scaling = modal_scaling(model_of(KUKA))
    np.testing.assert_allclose(np.linalg.norm(scaling.shapes, axis=1), 1)
    # φ = ψ / √m with φ of unit modal mass: m is one over its squared length.
    mass = 1 / np.sum(KUKA.shapes**2, axis=1)
    np.testing.assert_allclose(scaling.modal_mass, mass, rtol=EXACT)
    np.testing.assert_allclose(scaling.modal_a, 2j * KUKA.poles.imag * mass, rtol=EXACT)
    np.testing.assert_allclose(scaling.mass_phase_deg, 0, atol=1e-6)


def test_an_oscillator_has_the_modal_mass_it_has():
    # One mass on a spring and a damper: R = 1 / (2i m ω_d).
    m, d, k = 12.0, 30.0, 5e5
    pole = np.roots([m, d, k])[:1]
    model = ModalModel(pole, (1 / (2j * m * pole.imag))[:, None, None], ("a.x",), ("a.x",))
    scaling = modal_scaling(model)
    np.testing.assert_allclose(scaling.modal_mass, m)
    np.testing.assert_allclose(scaling.unit_modal_mass(), 1 / np.sqrt(m))


def test_shapes_of_a_chain_are_its_eigenvectors_however_it_is_hit():
    # Three masses, stiffness-proportional damping: eigenvectors by LAPACK.
    mass, K = np.array([2.0, 1.0, 3.0]), 1e4 * np.array([[2, -1, 0], [-1, 2, -1], [0, -1, 1.0]])
    w2, phi = np.linalg.eigh(K / np.sqrt(np.outer(mass, mass)))
    phi = phi.T / np.sqrt(mass)
    w, zeta = np.sqrt(w2), 0.5e-4 * np.sqrt(w2)
    poles = w * (-zeta + 1j * np.sqrt(1 - zeta**2))
    for outputs, inputs in (("abc", "a"), ("b", "abc"), ("abc", "abc"), ("ab", "bc"), ("abc", "ca")):
        scaling = modal_scaling(layout(poles, phi, outputs, inputs))
        order = ["abc".index(label[0]) for label in scaling.dofs]
        assert sorted(order) == [0, 1, 2]
        alike(scaling.unit_modal_mass(), phi[:, order])


def test_a_roving_hammer_extends_the_shape_over_the_points_it_hits():
    shapes = random_shapes(1, 4, 8)
    scaling = modal_scaling(layout(KUKA.poles, shapes, "c", "abcdefgh"))
    assert scaling.dofs == tuple(f"{x}.x" for x in "cabdefgh")
    alike(scaling.unit_modal_mass(), shapes[:, [2, 0, 1, 3, 4, 5, 6, 7]])


@pytest.mark.parametrize(
    "measured",
    [
        [[1, 0, 0], [1, 0, 0], [1, 0, 0]],
        [[1, 0, 0], [1, 1, 0], [0, 1, 0]],
        [[1, 1, 1], [0, 1, 1], [0, 0, 1]],
        [[0, 1, 1], [0, 0, 1], [0, 0, 0]],  # no driving point, but a triangle: ψ_x² = R_xy R_xz / R_yz
    ],
    ids=["column", "chain", "triangle", "loop"],
)
def test_missing_pairs_leave_scale_and_shape_as_long_as_the_others_fix_them(measured):
    scaling = modal_scaling(model_of(COMPLEX, measured=measured))
    assert scaling.scaled.all()
    alike(scaling.unit_modal_mass(), COMPLEX.shapes)
    np.testing.assert_allclose(scaling.rank_defect, 0, atol=EXACT)


def test_without_a_driving_point_shapes_have_no_scale_and_it_is_said_why():
    shapes = random_shapes(2, 4, 8)
    scaling = modal_scaling(layout(KUKA.poles, shapes, "abcd", "ef"))
    assert not scaling.scaled.any()
    assert all("both watched and hit" in reason for reason in scaling.unscaled)
    assert np.isnan(scaling.modal_mass).all()
    assert np.isnan(scaling.unit_modal_mass()).all()
    assert scaling.dofs == ("a.x", "b.x", "c.x", "d.x")
    np.testing.assert_allclose(np.diag(mac_table(scaling.shapes, shapes[:, :4])), 1)
    # A roving hammer far from its sensor gives the shape over the points it hits.
    hit = modal_scaling(layout(KUKA.poles, shapes, "h", "abcdefg"))
    assert len(hit.dofs) == 7
    np.testing.assert_allclose(np.diag(mac_table(hit.shapes, shapes[:, :7])), 1)


def test_a_driving_point_at_a_node_gives_no_scale():
    shapes = random_shapes(3, 4, 3)
    shapes[1, 0] = 0
    scaling = modal_scaling(layout(KUKA.poles, shapes, "abc", "ab"))
    assert scaling.scaled.all()  # b moves
    alone = modal_scaling(layout(KUKA.poles, shapes + 1e-9 * (shapes == 0), "abc", "a"))
    assert alone.scaled.tolist() == [True, False, True, True]
    assert "hardly moves" in alone.unscaled[1]


def test_points_that_no_pair_joins_have_no_shape():
    scaling = modal_scaling(model_of(KUKA, measured=np.eye(3, dtype=bool)))
    assert np.isfinite(scaling.shapes).sum(axis=1).tolist() == [1] * 4
    assert np.isfinite(scaling.unit_modal_mass()).sum(axis=1).tolist() == [1] * 4
    assert any("no measured pair joins" in remark for remark in scaling.remarks)
    np.testing.assert_allclose(scaling.auto_mac, 1)


def test_a_sensor_that_points_the_wrong_way_is_noticed():
    flipped = ModalModel(KUKA.poles, -KUKA.residues, KUKA.outputs, KUKA.inputs)
    scaling = modal_scaling(flipped)
    assert (scaling.modal_mass < 0).all()
    assert sum("opposite ways" in remark for remark in scaling.remarks) == 4
    assert modal_scaling(model_of(KUKA)).remarks == ()


# --- Complexity ---------------------------------------------------------------------------------------------


def test_real_shapes_are_real_and_complex_ones_as_complex_as_they_were_made():
    real, turned = modal_scaling(model_of(KUKA)), modal_scaling(model_of(COMPLEX))
    np.testing.assert_allclose(real.mpc, 1, rtol=EXACT)
    np.testing.assert_allclose(real.mpd_deg, 0, atol=1e-6)
    psi = COMPLEX.shapes
    np.testing.assert_allclose(turned.mpc, np.abs((psi**2).sum(1)) ** 2 / (np.abs(psi) ** 2).sum(1) ** 2, rtol=EXACT)


def test_auto_mac_is_the_mac_of_the_shapes_with_each_other():
    shapes = KUKA.shapes
    product = np.abs(shapes @ shapes.T) ** 2
    expected = product / np.outer(np.diag(product) ** 0.5, np.diag(product) ** 0.5)
    np.testing.assert_allclose(modal_scaling(model_of(KUKA)).auto_mac, expected, rtol=1e-9)


def test_two_modes_in_one_residue_matrix_show_in_its_rank():
    singular = np.array([1.0, 0.2])
    U = np.linalg.qr(np.random.default_rng(0).normal(size=(2, 2)))[0]
    matrix = (U * singular) @ U.T
    scaling = modal_scaling(ModalModel([-1 + 60j], matrix[None] * -1j, ("a.x", "a.y"), ("a.x", "a.y")))
    np.testing.assert_allclose(scaling.rank_defect, 0.2, rtol=EXACT)


def test_a_matrix_that_is_not_reciprocal_shows_it():
    skew = np.array([[0, 0.1], [-0.1, 0]])
    matrix = np.array([[1.0, 0.5], [0.5, 2.0]]) + skew
    scaling = modal_scaling(ModalModel([-1 + 60j], matrix[None] * -1j, ("a.x", "a.y"), ("a.x", "a.y")))
    np.testing.assert_allclose(scaling.reciprocity_defect, 0.2)  # 0.6 and 0.4: 0.2 apart, 1 together
    assert np.isnan(modal_scaling(layout(KUKA.poles, random_shapes(5, 4, 3), "abc", "a")).reciprocity_defect).all()


# --- Measured -----------------------------------------------------------------------------------------------


def test_modal_masses_of_noisy_responses_are_right_to_the_noise():
    fit = refine(KUKA.frfs(LINES_HZ, noise=0.01, seed=1), KUKA.poles)
    scaling = modal_scaling(fit.model)
    mass = 1 / np.sum(KUKA.shapes**2, axis=1)
    # Damping and with it the residue of the weakest mode is known to some parts in a thousand.
    np.testing.assert_allclose(scaling.modal_mass, mass, rtol=0.01)
    assert (np.abs(scaling.mass_phase_deg) < 1).all()
    assert (scaling.mpc > 0.999).all()
    assert (scaling.rank_defect < 0.02).all()


def test_a_symmetrized_model_has_no_reciprocity_defect():
    fit = refine(KUKA.frfs(LINES_HZ, noise=0.05, seed=2), KUKA.poles)
    assert (modal_scaling(fit.model).reciprocity_defect > 0).all()
    assert (modal_scaling(fit.model.symmetrized()).reciprocity_defect == 0).all()


def test_a_mode_without_residues_has_no_scale():
    residues = KUKA.residues.copy()
    residues[2] = 0
    scaling = modal_scaling(replace(model_of(KUKA), residues=residues))
    assert scaling.unscaled[2] == "the mode has no residues"
    assert np.isnan(scaling.modal_a[2])
