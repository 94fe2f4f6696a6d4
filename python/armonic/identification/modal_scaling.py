"""Scale of mode shapes from driving points, modal A and modal mass, and how complex and how alike the shapes are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from armonic.identification.modal_model import ModalModel, rank_one_factors, union
from armonic.identification.poles import unit_shapes
from armonic.identification.shape_criteria import mac_table, mean_phase_deviation_deg, modal_phase_collinearity

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array: TypeAlias = NDArray[np.float64]
    Complex: TypeAlias = NDArray[np.complex128]
    Mask: TypeAlias = NDArray[np.bool_]

AT_NODE = 1e-3
"""A driving point that moves by less than this share of the shape's length gives it no scale."""
WRONG_SIGN_DEG = 90.0
"""Phase of the modal mass from which on hammer and sensor must point opposite ways."""
POLISH, ARRIVED = 20, 1e-14
"""Most steps of Gauss and Newton towards the symmetric matrix of rank one, and a step that is rounding."""


@dataclass(frozen=True, eq=False, repr=False)
class ModalScaling:
    """Shapes over all degrees of freedom that were watched or hit, with their scale: R_r = ψ_r ψ_rᵀ / a_r.

    Attributes:
        poles: λ, (m,), rad/s.
        dofs: degrees of freedom, the entries of every shape: the outputs, then inputs that are no outputs. Where
            nothing joins the two, those of the larger side only.
        shapes: ψ by rows, (m, dofs), of unit length, turned so that the largest entry is real and positive; NaN where
            the measured pairs do not reach.
        modal_a: a of those shapes, (m,), complex; NaN where a mode has no scale.
        modal_mass: real part of a / (2i Im λ), (m,), kg for translations, of those shapes: the modal mass, if the
            shape is nearly real; NaN where a mode has no scale.
        mass_phase_deg: phase of that quotient, (m,): 0 for a real mode of a passive structure.
        unscaled: per mode, why it has no scale; "" if it has one.
        mpc: modal phase collinearity of each shape, (m,), 1 for a real one.
        mpd_deg: mean phase deviation, (m,), 0 for a real one.
        rank_defect: what the nearest matrix of rank one leaves of each residue matrix, over that matrix, (m,): 0 for a
            single mode; σ₂/σ₁ where there are two singular values.
        reciprocity_defect: ‖R − Rᵀ‖ / ‖R + Rᵀ‖ over pairs measured both ways, (m,); NaN if there are none.
        remarks: what a user should look at.
    """

    poles: Complex
    dofs: tuple[str, ...]
    shapes: Complex
    modal_a: Complex
    modal_mass: Array
    mass_phase_deg: Array
    unscaled: tuple[str, ...]
    mpc: Array
    mpd_deg: Array
    rank_defect: Array
    reciprocity_defect: Array
    remarks: tuple[str, ...]

    def __repr__(self) -> str:
        """Modes, degrees of freedom and scale in one line."""
        scaled = sum(not reason for reason in self.unscaled)
        return f"ModalScaling({len(self.poles)} modes over {len(self.dofs)} degrees of freedom, {scaled} scaled)"

    @property
    def scaled(self) -> Mask:
        """Which modes have a scale, (m,)."""
        return np.array([not reason for reason in self.unscaled], bool)

    @property
    def auto_mac(self) -> Array:
        """MAC of every shape with every other, (m, m), where the measured pairs reach."""
        shapes = self.shapes[:, np.isfinite(self.shapes).all(axis=0)]
        return mac_table(shapes, shapes)

    def unit_modal_a(self) -> Complex:
        """Shapes with a = 1, so that R = ψψᵀ, (m, dofs); the largest entry has a positive real part."""
        return self._scaled(np.ones(len(self.poles)))

    def unit_modal_mass(self) -> Complex:
        """Shapes φ with R = φφᵀ / (2i Im λ), (m, dofs), 1/√kg; real for real modes, the largest entry positive.

        For a complex mode this is the same scale, by the damped frequency; it has no modal mass in the strict sense.
        """
        return self._scaled(np.asarray(2j * self.poles.imag, np.complex128))

    def _scaled(self, target: Complex | Array) -> Complex:
        """Shapes with a = target, NaN without scale; of the two signs that with the largest entry to the right."""
        scaled, known = np.full(self.shapes.shape, np.nan, np.complex128), self.scaled
        reach = np.isfinite(self.shapes).all(axis=0)
        shapes = self.shapes[known][:, reach] * np.sqrt(target[known] / self.modal_a[known])[:, None]
        largest = np.take_along_axis(shapes, np.argmax(np.abs(shapes), axis=1)[:, None], axis=1)
        scaled[np.ix_(known, reach)] = np.where(largest.real < 0, -shapes, shapes)
        return scaled


def modal_scaling(model: ModalModel) -> ModalScaling:
    """Shapes with their scale from the residues of a modal model (Ewins 2000; Heylen et al. 1998).

    A single mode has a residue matrix of rank one that is symmetric by reciprocity, R = ψψᵀ / a: where some degree of
    freedom is both watched and hit, its scale is determined, and hits extend the shape as responses do (roving hammer).
    All measured pairs are fitted in least squares; for a full symmetric matrix that is Takagi's factorization.

    Args:
        model: residues; pairs may be missing.

    Returns:
        Shapes, scale and complexity. Modes without scale say why.
    """
    m, dofs = len(model), union(model.outputs, model.inputs)
    R, measured = model.residues, model.measured
    S, seen, both = _symmetric(model, dofs)
    reach, joined = _reach(seen)
    if joined:
        shapes = _takagi(S[:, reach][:, :, reach], seen[np.ix_(reach, reach)])
        unscaled = tuple(_weakness(shape, np.flatnonzero(np.diagonal(seen)[reach])) for shape in shapes)
    else:
        watched = len(model.outputs) >= len(model.inputs)
        dofs = model.outputs if watched else model.inputs
        reach = _component(measured if watched else measured.T)
        shapes = rank_one_factors(R, measured)[0 if watched else 1][:, reach]
        unscaled = ("no degree of freedom is both watched and hit",) * m
    length = np.linalg.norm(shapes, axis=1)
    unit = unit_shapes(shapes)
    turn = np.einsum("mk,mk->m", unit.conj(), shapes)  # what unit length and turning took off
    known = np.array([not reason for reason in unscaled], bool) & (length > 0)
    modal_a = np.full(m, np.nan, np.complex128)
    modal_a[known] = 1 / turn[known] ** 2
    mass = np.full(m, np.nan, np.complex128)
    mass[known] = modal_a[known] / (2j * model.poles.imag[known])
    full = np.full((m, len(dofs)), np.nan, np.complex128)
    full[:, reach] = unit
    phase = np.rad2deg(np.angle(mass))
    return ModalScaling(
        poles=model.poles,
        dofs=dofs,
        shapes=full,
        modal_a=modal_a,
        modal_mass=mass.real,
        mass_phase_deg=phase,
        unscaled=unscaled,
        mpc=modal_phase_collinearity(unit),
        mpd_deg=mean_phase_deviation_deg(unit),
        rank_defect=_rank_defect(R, measured),
        reciprocity_defect=_reciprocity_defect(model, both),
        remarks=_remarks(model, dofs, reach, phase),
    )


def _symmetric(model: ModalModel, dofs: tuple[str, ...]) -> tuple[Complex, Mask, Mask]:
    """Residues over all degrees of freedom, mirrored and averaged; which are known, and which were measured twice."""
    rows = [dofs.index(label) for label in model.outputs]
    columns = [dofs.index(label) for label in model.inputs]
    count = np.zeros((len(dofs), len(dofs)))
    count[np.ix_(rows, columns)] = model.measured
    S = np.zeros((len(model), len(dofs), len(dofs)), np.complex128)
    S[:, np.array(rows)[:, None], np.array(columns)] = model.residues
    S, count = S + S.transpose(0, 2, 1), count + count.T
    return S / np.maximum(count, 1), count > 0, count > 1


def _reach(seen: Mask) -> tuple[NDArray[np.intp], bool]:
    """The largest set of degrees of freedom that measured pairs join, and whether they fix the scale of its shape.

    They do if some chain of pairs leads back to where it began in an odd number of steps, as a driving point does in
    one: in an even number, one half of the set may grow as the other shrinks.
    """
    best: tuple[NDArray[np.intp], bool] = (np.arange(0), False)
    left = np.ones(len(seen), bool)
    while left.any():
        even, odd = np.zeros(len(seen), bool), np.zeros(len(seen), bool)
        even[np.argmax(left)] = True
        while True:
            more_odd, more_even = odd | seen[even].any(axis=0), even | seen[odd].any(axis=0)
            if (more_odd == odd).all() and (more_even == even).all():
                break
            even, odd = more_even, more_odd
        here, fixed = even | odd, bool((even & odd).any())
        if (fixed, here.sum()) > (best[1], len(best[0])):
            best = np.flatnonzero(here), fixed
        left &= ~here
    return best


def _component(measured: Mask) -> NDArray[np.intp]:
    """The largest set of rows that share columns, directly or through others."""
    shared = measured.astype(np.int64) @ measured.T > 0
    while True:
        wider = shared.astype(np.int64) @ shared > 0
        if (wider == shared).all():
            return np.flatnonzero(shared[np.argmax(shared.sum(axis=1))])
        shared = wider


def _takagi(S: Complex, seen: Mask) -> Complex:
    """ψ with S ≈ ψψᵀ over the known entries of each matrix, (m, n), in least squares."""
    x, y = rank_one_factors(S, seen)
    # A symmetric matrix has y = αx.
    shapes = x * np.sqrt(np.einsum("mk,mk->m", x.conj(), y).astype(np.complex128))[:, None]
    rows, columns = np.nonzero(seen)
    k = np.arange(len(rows))
    slope = np.zeros((len(rows), seen.shape[0]), np.complex128)
    for shape, matrix in zip(shapes, S, strict=True):
        for _ in range(POLISH):
            slope[:] = 0
            slope[k, rows] += shape[columns]
            slope[k, columns] += shape[rows]
            step = np.linalg.lstsq(slope, matrix[rows, columns] - shape[rows] * shape[columns])[0]
            shape += step
            if np.linalg.norm(step) <= ARRIVED * np.linalg.norm(shape):
                break
    return np.asarray(shapes, np.complex128)


def _weakness(shape: Complex, driving: NDArray[np.intp]) -> str:
    if not shape.any():
        return "the mode has no residues"
    if driving.size and np.linalg.norm(shape[driving]) < AT_NODE * np.linalg.norm(shape):
        return "it hardly moves where it is both watched and hit"
    return ""


def _rank_defect(R: Complex, measured: Mask) -> Array:
    """What the best matrix of rank one leaves over the measured pairs, over that matrix."""
    x, y = rank_one_factors(R, measured)
    left = np.linalg.norm(np.where(measured, R - x[:, :, None] * y[:, None, :], 0), axis=(1, 2))
    whole = np.linalg.norm(np.where(measured, x[:, :, None] * y[:, None, :], 0), axis=(1, 2))
    return np.asarray(np.divide(left, whole, out=np.zeros(len(R)), where=whole > 0))


def _reciprocity_defect(model: ModalModel, both: Mask) -> Array:
    dofs = union(model.outputs, model.inputs)
    pairs = [
        (i, j, model.outputs.index(b), model.inputs.index(a))
        for i, a in enumerate(model.outputs)
        for j, b in enumerate(model.inputs)
        if a != b and both[dofs.index(a), dofs.index(b)]
    ]
    if not pairs:
        return np.full(len(model), np.nan)
    i, j, k, n = np.array(pairs).T
    one, other = model.residues[:, i, j], model.residues[:, k, n]
    apart, together = np.linalg.norm(one - other, axis=1), np.linalg.norm(one + other, axis=1)
    return np.asarray(np.divide(apart, together, out=np.full(len(model), np.inf), where=together > 0))


def _remarks(model: ModalModel, dofs: tuple[str, ...], reach: NDArray[np.intp], phase: Array) -> tuple[str, ...]:
    remarks = []
    lost = [label for k, label in enumerate(dofs) if k not in reach]
    if lost:
        remarks.append(f"no measured pair joins {', '.join(lost)} to the others: no shape there")
    for freq, angle in zip(model.natural_freq_hz, phase, strict=True):
        if abs(angle) > WRONG_SIGN_DEG:
            remarks.append(
                f"mode at {freq:.4g} Hz has a negative modal mass: hammer and sensor point opposite ways, or it is none"
            )
    return tuple(remarks)
