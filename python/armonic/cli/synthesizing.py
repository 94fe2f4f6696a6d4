"""From measured files straight to what a fit takes: responses synthesized from identified modes, or as estimated."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from armonic.cli.arguments import UsageError
from armonic.cli.campaign import Estimating, FileReading, Responses, responses
from armonic.cli.terminal import remark, stages_progress
from armonic.errors import SignalError

if TYPE_CHECKING:
    from armonic.identification.ema import EmaResult
    from armonic.identification.synthesized import Synthesized
    from armonic.response import Frf

LEAST_FRAC = 0.8
"""A response that the modes meet less well is named."""


def measured_matrix(
    path: Path, channels: Path | None, *, band: tuple[float, float] | None, place: str | None
) -> tuple[Frf, Any]:
    """The matrix at the tip from a file of time records, and its coherence.

    Raises:
        ArmonicError: the file, or what it holds, makes none.
    """
    found = responses([path], FileReading(channels), Estimating())
    _tell(found)
    frfs = found.frfs if band is None else found.frfs.band(*band)
    return frfs.matrix(_place(found, place))


def matrix_of_modes(
    path: Path, channels: Path | None, *, band: tuple[float, float] | None, place: str | None, side: Any
) -> Synthesized:
    """The matrix synthesized from the modes of a measured file, made reciprocal, its coherence, and the one measured.

    The route of Huynh et al. 2021, section 5.3: measured, identified, synthesized, symmetrized, then fitted; see
    `armonic.synthesized_matrix`.

    Args:
        path: time records or frequency responses.
        channels: the map of its channels.
        band: the lines that are used, Hz.
        place: where the matrix is; by default the only one with responses and forces.
        side: "average", "upper" or "lower".

    Raises:
        ArmonicError: the file makes no responses, or they hold no mode.
    """
    from armonic.identification.ema import ema
    from armonic.identification.synthesized import synthesized_matrix

    found = responses([path], FileReading(channels), Estimating())
    _tell(found)
    at = _place(found, place)
    with stages_progress("Identifying") as progress:
        result = ema(found.frfs, band_hz=band, progress=progress)
    if not result.modes:
        raise SignalError(
            str(path),
            found="no mode in its responses",
            expected="modes to synthesize from",
            hint="Look at it with `armonic ema`, and fit the responses as they are, without --synthesize.",
        )
    _tell_modes(path, result)
    return synthesized_matrix(result, at, symmetric=side)


def _place(found: Responses, typed: str | None) -> str | None:
    """The place that was typed, if the file knows it; a file of nodes alone has its own names."""
    if typed in found.frfs.places:
        return typed
    both = found.frfs.driven
    if len(both) > 1:
        raise UsageError("--frame", found=f"responses and forces at {', '.join(both)}", expected="one of them")
    return None


def _tell(found: Responses) -> None:
    for text in (*found.file.remarks, *(found.estimate.remarks if found.estimate else ())):
        remark(text)
    for left in found.file.skipped:
        remark(f"not read: {left}")


def _tell_modes(path: Path, result: EmaResult) -> None:
    listed = ", ".join(f"{m.natural_freq_hz:.4g} Hz ({100 * m.damping_ratio:.2g} %)" for m in result.modes)
    remark(f"{path.name}: synthesized from {listed}")
    frfs = result.frfs
    for i, output in enumerate(frfs.outputs):
        for j, force in enumerate(frfs.inputs):
            if result.frac[i, j] < LEAST_FRAC:
                remark(
                    f"{output} to {force}: the modes meet the measurement with a FRAC of {result.frac[i, j]:.2f} only"
                )
