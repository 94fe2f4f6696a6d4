"""Experimental modal analysis: from frequency responses to modes, their residues and synthesized responses."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, get_args

import numpy as np

from armonic.assurance import frac_of
from armonic.comparison import ModeTable
from armonic.errors import FrfError, SignalError
from armonic.frf_set import FrfSet
from armonic.identification.clustering import select_modes
from armonic.identification.complex_exponential import complex_exponential
from armonic.identification.modal_model import Side
from armonic.identification.modal_scaling import modal_scaling
from armonic.identification.poles import unit_shapes
from armonic.identification.polyreference import polyreference_lscf
from armonic.identification.refinement import WEAK
from armonic.identification.refinement import refine as refined
from armonic.identification.residues import fit_residues
from armonic.identification.samples import blas_on_one_thread, checked_band, checked_orders
from armonic.identification.selection import SelectedMode, rejected_for
from armonic.identification.stabilization import Criteria, Stabilization, stabilize
from armonic.response import KINDS, Frf

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from armonic.experiment.estimation import FrfEstimate
    from armonic.identification.modal_model import ModalModel
    from armonic.identification.modal_scaling import ModalScaling
    from armonic.identification.poles import ModelPoles
    from armonic.identification.refinement import Refinement
    from armonic.identification.selection import RejectedMode
    from armonic.response import Kind

    Array: TypeAlias = NDArray[np.float64]

Method = Literal["plscf", "lsce"]
"""Polyreference least-squares complex frequency domain, or least-squares complex exponentials."""
MOST_ORDER = 60
"""Largest model order where none is asked for."""
FAR = 0.1
"""A pole that refinement moves by more than this share is not the one that was selected."""
LEAST_ENERGY = 1e-10
"""No measurement shows a mode of a smaller share of the energy."""
SATELLITE = 0.3
"""A pole beside a mode that has less of the energy than this share of it is a satellite."""
FELL_TOGETHER = "refined, it falls together with another mode"
LEAST_LINES = 16
"""Fewer say nothing of modes."""
LINES_PER_WIDTH = 4
"""Lines within its half-power bandwidth that a mode should have where blocks of a lasting motion were cut out."""
SAME = 1e-3
"""Two poles closer than this share after refinement are one mode found twice."""


@dataclass(frozen=True, eq=False, repr=False)
class EmaResult:
    """The modes of frequency responses, the model that they make, and everything they were chosen from.

    Attributes:
        method: how the poles were found.
        measured: the responses as given.
        frfs: the lines of them that were identified.
        orders: first and last model order.
        stabilization: the poles of all orders.
        modes: those selected, by natural frequency, with refined poles; standard deviations are those of the
            refinement, of the scatter over the orders without one.
        rejected: groups of poles that hold over the orders and are no modes, with the reason.
        channels: labels of the entries of every shape.
        model: poles, residues and residuals; synthesizes responses.
        refinement: of the poles, with their covariance; None if it was not asked for.
        scaling: modal A, modal mass, complexity and scaled shapes.
        frac: how alike measured and synthesized responses are, (outputs, inputs); not a number where not measured.
        remarks: what a user should know, in full sentences.
        seconds: how long it took.
    """

    method: Method
    measured: FrfSet
    frfs: FrfSet
    orders: tuple[int, int]
    stabilization: Stabilization
    modes: tuple[SelectedMode, ...]
    rejected: tuple[RejectedMode, ...]
    channels: tuple[str, ...]
    model: ModalModel
    refinement: Refinement | None
    scaling: ModalScaling
    frac: Array
    remarks: tuple[str, ...]
    seconds: float

    def __repr__(self) -> str:
        """How many modes, and out of what, in one line."""
        low, high = self.orders
        return f"EmaResult({len(self.modes)} modes by {self.method} of orders {low} to {high}, from {self.frfs!r})"

    @property
    def poles(self) -> NDArray[np.complex128]:
        """λ of each mode, (modes,), rad/s."""
        return self.model.poles

    @property
    def natural_freq_hz(self) -> Array:
        """|λ| / 2π of each mode, (modes,)."""
        return self.model.natural_freq_hz

    @property
    def damping_ratio(self) -> Array:
        """−Re λ / |λ| of each mode, (modes,), a fraction."""
        return self.model.damping_ratio

    @property
    def freq_std_hz(self) -> Array:
        """Standard deviation of each natural frequency, (modes,)."""
        return np.array([mode.freq_std_hz for mode in self.modes])

    @property
    def damping_std(self) -> Array:
        """Standard deviation of each damping ratio, (modes,)."""
        return np.array([mode.damping_std for mode in self.modes])

    def table(self) -> ModeTable:
        """Poles and shapes with the names of their entries, as files of modes and `compare` take them."""
        shapes = np.array([mode.shape for mode in self.modes]).reshape(len(self.modes), len(self.channels))
        return ModeTable(self.poles, shapes, self.channels)

    def synthesized(
        self,
        freq_hz: ArrayLike | None = None,
        kind: Kind | None = None,
        *,
        symmetric: Side | None = None,
        residuals: bool = True,
    ) -> FrfSet:
        """Responses made of the modes (Huynh et al. 2021, section 5.3): without noise and without a window.

        Args:
            freq_hz: lines, Hz; those that were identified if not given.
            kind: by default that of the measurement.
            symmetric: make them reciprocal: "average" of the two cross responses, or the "upper" or "lower" triangle.
            residuals: with what modes outside the band leave inside.

        Raises:
            FrfError: a line or word makes no sense.
        """
        model = self.model if symmetric is None else self.model.symmetrized(symmetric)
        lines = self.frfs.freq_hz if freq_hz is None else np.asarray(freq_hz, np.float64)
        return replace(model.frfs(lines, kind or self.frfs.kind, residuals=residuals), notes=dict(self.measured.notes))


def ema(
    frfs: FrfSet | Frf | FrfEstimate,
    *,
    method: Method = "plscf",
    orders: range | tuple[int, int] | None = None,
    band_hz: tuple[float, float] | None = None,
    criteria: Criteria | None = None,
    least_share: float | None = None,
    refine: bool = True,
    real: bool = False,
    progress: Callable[[str], object] | None = None,
) -> EmaResult:
    """Modes from frequency responses: poles of every model order, those that hold, refined, with residues.

    Args:
        frfs: the responses: a set, the matrix of one sensor, or what `estimate_frf` made of time records.
        method: "plscf" (Peeters et al. 2004) or "lsce" (Vold et al. 1982), the one of Huynh et al. 2021.
        orders: orders of the matrix polynomials; by default 2 to 60, or as many as the lines allow.
        band_hz: the lines that are used, ends included; all if not given.
        criteria: what makes a pole stable in the stabilization diagram.
        least_share: share of the orders that must hold a mode; by default that of `select_modes`.
        refine: bring poles and residues to least squares of the responses, each value weighed by its coherence, and
            give their standard deviations.
        real: residues of real modes, as proportional damping has them.
        progress: called with the name of each stage; what it raises ends the work.

    Raises:
        SignalError: method, orders or band make no sense.
        FrfError: the responses cannot be identified.
    """
    began = time.perf_counter()
    say = progress or (lambda stage: None)
    if method not in get_args(Method):
        raise SignalError("method", found=repr(method), expected=f"one of {', '.join(get_args(Method))}")
    given = as_set(frfs)
    band = checked_band(band_hz)
    used, doubts = _usable(given if band is None else given.band(*band))
    asked = _default_orders(used) if orders is None else orders
    listed = checked_orders(asked)
    say(f"poles of orders {listed[0]} to {listed[-1]}")
    models = _poles(used, method, asked, band)
    say("comparing orders")
    stabilization = stabilize(models, criteria)
    say("selecting modes")
    share: dict[str, Any] = {} if least_share is None else {"least_share": least_share}
    chosen = select_modes(stabilization, combinations=False, **share)
    low, high = used.freq_hz[0], used.freq_hz[-1]
    inside = [mode for mode in chosen.modes if low <= mode.natural_freq_hz <= high and mode.damping_ratio > 0]
    say("fitting poles and residues" if refine else "fitting residues")
    with blas_on_one_thread():
        model, refinement, kept, dropped, remarks = _fitted(used, inside, refine=refine, real=real)
    scaling = modal_scaling(model)
    modes = [replace(mode, shape=shape) for mode, shape in zip(kept, unit_shapes(scaling.shapes), strict=True)]
    return EmaResult(
        method=method,
        measured=given,
        frfs=used,
        orders=(listed[0], listed[-1]),
        stabilization=stabilization,
        modes=tuple(modes),
        rejected=tuple(sorted((*chosen.rejected, *dropped), key=lambda mode: mode.natural_freq_hz)),
        channels=scaling.dofs,
        model=model,
        refinement=refinement,
        scaling=scaling,
        frac=_frac(used, model),
        remarks=(*doubts, *remarks, *_leakage(frfs, model)),
        seconds=time.perf_counter() - began,
    )


def as_set(given: Any) -> FrfSet:
    """The responses as a set, whatever holds them.

    Raises:
        FrfError: nothing that holds responses.
    """
    if isinstance(given, Frf):
        return FrfSet.from_frf(given)
    inner = getattr(given, "frfs", given)
    if not isinstance(inner, FrfSet):
        raise FrfError("frfs", found=f"a {type(given).__name__}", expected="an FrfSet, an Frf or an FrfEstimate")
    return inner


def _usable(frfs: FrfSet) -> tuple[FrfSet, list[str]]:
    """Without a line at 0 Hz, where no kind of motion but a displacement is left, and without pairs of no coherence.

    Raises:
        FrfError: fewer than 16 lines, or no coherence anywhere.
    """
    frfs = frfs if frfs.freq_hz[0] > 0 else frfs.lines(np.arange(1, len(frfs.freq_hz)))
    lines = len(frfs.freq_hz)
    if lines < LEAST_LINES:
        raise FrfError("FrfSet.freq_hz", found=f"{lines} lines above 0 Hz", expected=f"at least {LEAST_LINES}")
    if frfs.coherence is None:
        return frfs, []
    lost = frfs.measured & ~frfs.coherence.any(axis=0)
    if not lost.any():
        return frfs, []
    if not (frfs.measured & ~lost).any():
        raise FrfError("FrfSet.coherence", found="zero everywhere", expected="responses that are due to the force")
    named = ", ".join(f"{frfs.outputs[i]} to {frfs.inputs[j]}" for i, j in np.argwhere(lost))
    return replace(frfs, measured=frfs.measured & ~lost), [f"left out, for its coherence is zero: {named}"]


def _leakage(source: Any, model: ModalModel) -> list[str]:
    """Modes that blocks are too short for; a decay under an exponential window has no such limit."""
    if getattr(source, "excitation", "hits") == "hits":
        return []
    step = 1 / source.window_s
    narrow = [
        f"{freq:.4g} Hz"
        for freq, damping in zip(model.natural_freq_hz, model.damping_ratio, strict=True)
        if 2 * damping * freq < LINES_PER_WIDTH * step
    ]
    if not narrow:
        return []
    wide = f"blocks of {source.window_s:.3g} s are too short for the damping at {', '.join(narrow)}"
    return [f"{wide}: it comes out too high; take longer ones"]


def _default_orders(frfs: FrfSet) -> tuple[int, int]:
    """2 to 60, or what lines and responses are good for."""
    references = min(len(frfs.outputs), len(frfs.inputs)) if frfs.complete else 1
    lines = len(frfs.freq_hz)
    return 2, max(4, min(MOST_ORDER, lines // 4, 2 * lines // (references + 2) - 1))


def _poles(
    frfs: FrfSet, method: Method, orders: range | tuple[int, int], band: tuple[float, float] | None
) -> list[ModelPoles]:
    if method == "plscf":
        return polyreference_lscf(frfs, orders=orders, band_hz=band)
    return complex_exponential(frfs, orders=orders, band_hz=band)


Fitted: TypeAlias = "tuple[ModalModel, Refinement | None, list[SelectedMode], list[RejectedMode], list[str]]"


def _fitted(frfs: FrfSet, modes: Sequence[SelectedMode], *, refine: bool, real: bool) -> Fitted:
    """The modal model of the selected modes; refined ones that turn out to be none are taken out one by one.

    Each round goes on from the poles of the one before, those outside the band too, which take longest to find.
    """
    kept: list[SelectedMode] = list(modes)
    dropped: list[RejectedMode] = []
    poles = np.array([mode.pole for mode in kept], np.complex128)
    if not refine or not kept:
        return fit_residues(frfs, poles, real=real), None, kept, dropped, []
    background: NDArray[np.complex128] | Literal["auto"] = "auto"
    while True:
        try:
            found = refined(frfs, poles, background=background, real=real)
        except SignalError as error:
            if "twice" not in error.found or len(kept) < 2:
                raise
            index, reason = _twin(kept), FELL_TOGETHER
        else:
            refuted = _refuted(found, np.array([mode.pole for mode in kept]), frfs)
            if refuted is None:
                break
            index, reason = refuted
            poles, background = found.model.poles, found.model.background_poles
        poles = np.delete(poles, index)
        dropped.append(rejected_for(kept.pop(index), reason))
        if not kept:
            return fit_residues(frfs, poles, real=real), None, kept, dropped, []
    return found.model, found, _with_poles(kept, found), dropped, list(found.remarks)


def _twin(modes: Sequence[SelectedMode]) -> int:
    """Of the two modes that lie closest together the one that fewer orders hold."""
    poles = np.array([mode.pole for mode in modes])
    apart = np.abs(poles[:, None] / poles - 1) + np.diag(np.full(len(poles), np.inf))
    pair = np.unravel_index(np.argmin(apart), apart.shape)
    return int(min(pair, key=lambda k: modes[int(k)].orders))


def _refuted(found: Refinement, start: NDArray[np.complex128], frfs: FrfSet) -> tuple[int, str] | None:
    """The mode that the responses support least, if there is one that they do not, and why."""
    model = found.model
    weak = int(np.argmin(found.significance))
    if found.significance[weak] < WEAK:
        return weak, "the responses are fitted as well without it: a pole in noise"
    faint = int(np.argmin(found.energy_share))
    if found.energy_share[faint] < LEAST_ENERGY:
        return faint, "it has no part in the responses: a pole of rounding"
    for k, (pole, before) in enumerate(zip(model.poles, start, strict=True)):
        if pole.real >= 0:
            return k, "refined, it grows"
        if abs(pole / before - 1) > FAR:
            return k, "refined, it wanders off: the responses hold no such pole"
        near = np.abs(model.poles / pole - 1) < SAME * max(1.0, found.damping_std[k] / SAME)
        near[k] = False
        if near.any() and found.significance[k] <= found.significance[near].max():
            return k, FELL_TOGETHER
    freq, damping, share = model.natural_freq_hz, model.damping_ratio, found.energy_share
    for k in np.argsort(share):
        # Within its own half-power bandwidth of a stronger mode with less damping.
        near = np.abs(freq - freq[k]) < damping[k] * freq[k]
        near &= (share > share[k] / SATELLITE) & (damping < damping[k])
        if near.any():
            told = f"a satellite of the mode at {freq[np.argmax(near)]:.4g} Hz, as amplitudes make them that change"
            return int(k), f"{told} stiffness"
    outside = (model.natural_freq_hz < frfs.freq_hz[0]) | (model.natural_freq_hz > frfs.freq_hz[-1])
    if outside.any():
        return int(np.argmax(outside)), "refined, it lies outside the band"
    return None


def _with_poles(modes: Sequence[SelectedMode], found: Refinement) -> list[SelectedMode]:
    model = found.model
    return [
        replace(
            mode,
            pole=complex(model.poles[k]),
            natural_freq_hz=float(model.natural_freq_hz[k]),
            damping_ratio=float(model.damping_ratio[k]),
            freq_std_hz=float(found.freq_std_hz[k]),
            damping_std=float(found.damping_std[k]),
        )
        for k, mode in enumerate(modes)
    ]


def _frac(frfs: FrfSet, model: ModalModel) -> Array:
    """How alike measured and synthesized responses are, at the lines as measured, beside the axis or on it."""
    made = model.receptance(frfs.s) * (frfs.s ** KINDS.index(frfs.kind))[:, None, None]
    return np.where(frfs.measured, frac_of(frfs.values, made), np.nan)
