"""Records of shakers: blocks under a Hann window, and the lines that their forces excite."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from armonic.errors import SignalError
from armonic.experiment.spectra import LEAST_SAMPLES, Block, Usable, accelerations

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array: TypeAlias = NDArray[np.float64]

BLOCKS = 8
"""Blocks without overlap that a record is cut into where nothing is asked."""
FAINT_DB = 40.0
"""A force that is weaker by so much than at its strongest line does not excite."""
LEAST_LINES = 10
"""Of a sine, a Hann window leaves seven above that level."""


def block_samples(records: Sequence[Usable], asked_s: float | None) -> int:
    """Samples of a block: as asked, or an eighth of the median record.

    Raises:
        SignalError: fewer than 16.
    """
    rate = records[0].record.sample_rate_hz
    if asked_s is None:
        samples = int(np.median([len(one.record) for one in records])) // BLOCKS
        if samples < LEAST_SAMPLES:
            found = f"records of {samples * BLOCKS} samples"
            raise SignalError("records", found=found, expected=f"at least {LEAST_SAMPLES * BLOCKS}")
        return samples
    samples = round(asked_s * rate)
    if samples < LEAST_SAMPLES:
        raise SignalError("window_s", found=f"{asked_s:g} s", expected=f"at least {LEAST_SAMPLES / rate:g} s")
    return samples


def all_blocks(records: Sequence[Usable], samples: int, overlap: float) -> tuple[list[Block], list[str]]:
    """The blocks of all records, and what is to be said of those that gave none.

    Raises:
        SignalError: no record holds a whole block of numbers.
    """
    found: list[Block] = []
    remarks = []
    for one in records:
        own = _blocks(one, samples, overlap)
        if not own:
            remarks.append(f"Record {one.number + 1} holds no whole block of numbers: it is left out.")
        found += own
    if not found:
        length = samples / records[0].record.sample_rate_hz
        said = f"no whole block of {length:g} s of numbers"
        raise SignalError("window_s", found=said, expected="blocks that the records hold")
    return found, remarks


def _blocks(one: Usable, samples: int, overlap: float) -> list[Block]:
    record, known, rate = one.record, one.roles, one.record.sample_rate_hz
    hann = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(samples) / samples)
    columns = [*known.forces, *known.responses]
    freq, n, found = np.fft.rfftfreq(samples, 1 / rate), len(known.forces), []
    for start in range(0, len(record) - samples + 1, max(1, round((1 - overlap) * samples))):
        part = record.values[start : start + samples, columns] * known.factors[columns]
        if not np.isfinite(part).all():
            continue
        spectra = np.fft.rfft((part - part.mean(axis=0)) * hann[:, None], axis=0) / rate
        responses = accelerations(spectra[:, n:], known.powers, freq)
        found.append(Block(known.inputs, known.outputs, spectra[:, :n], responses))
    return found


def excited(force: Array, freq_hz: Array, top_hz: float) -> tuple[float, float]:
    """First and last frequency that all forces excite, up to a limit.

    Args:
        force: mean squares of the transforms, (L, inputs).
        freq_hz: (L,).
        top_hz: the limit.

    Raises:
        SignalError: they excite fewer than ten lines.
    """
    inside = (freq_hz > 0) & (freq_hz <= top_hz)
    level = 10 * np.log10(np.maximum(force, np.finfo(float).tiny))
    strong = np.flatnonzero((level >= level[inside].max(axis=0) - FAINT_DB).all(axis=1) & inside)
    if len(strong) < LEAST_LINES:
        loudest = freq_hz[strong[np.argmax(level[strong].sum(axis=1))]] if len(strong) else 0.0
        said = f"a force that excites {loudest:.4g} Hz only" if len(strong) else "forces without common lines"
        raise SignalError("records", found=said, expected="a random force, or a sweep")
    return float(freq_hz[strong[0]]), float(freq_hz[strong[-1]])
