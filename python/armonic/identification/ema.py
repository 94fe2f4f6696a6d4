"""Experimental modal analysis: from frequency responses to modes, their residues and synthesized responses."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, get_args

import numpy as np

from armonic.errors import FrfError, SignalError
from armonic.frf_set import FrfSet
from armonic.identification.clustering import select_modes
from armonic.identification.complex_exponential import complex_exponential
from armonic.identification.modal_model import Side
from armonic.identification.modal_scaling import modal_scaling
from armonic.identification.polyreference import polyreference_lscf
from armonic.identification.refinement import refine as refined
from armonic.identification.residues import fit_residues
from armonic.identification.samples import checked_band, checked_orders
from armonic.identification.selection import SelectedMode, rejected_for
from armonic.identification.stabilization import Criteria, Stabilization, stabilize
from armonic.response import Frf

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
MOST_ORDER: dict[str, int] = {"plscf": 60, "lsce": 60}
"""Largest model order where none is asked for."""
FAR = 0.1
"""A pole that refinement moves by more than this share is not the one that was selected."""
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
    used = _usable(given if band is None else given.band(*band))
    asked = _default_orders(used, method) if orders is None else orders
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
    say("fitting residues")
    model, refinement, modes, dropped, remarks = _fitted(used, inside, refine=refine, real=real)
    scaling = modal_scaling(model)
    modes = [replace(mode, shape=shape) for mode, shape in zip(modes, _unit(scaling.shapes), strict=True)]
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
        remarks=tuple(remarks),
        seconds=time.perf_counter() - began,
    )
