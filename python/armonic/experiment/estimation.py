"""From time records to frequency responses: of hammers by hits, of shakers by blocks."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from numbers import Real
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, get_args

import numpy as np

from armonic.errors import SignalError
from armonic.experiment.estimators import Estimator, frf_estimate
from armonic.experiment.shaking import all_blocks, block_samples, excited
from armonic.experiment.signals import as_records, full_scales, roles
from armonic.experiment.spectra import Block, Usable
from armonic.experiment.tapping import all_tapped, chosen_hits, decay_of, looks_like_hits, window_samples
from armonic.frf_set import FrfSet
from armonic.response import KINDS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from armonic.experiment.hits import Hit
    from armonic.series import TimeSeries

    Array: TypeAlias = NDArray[np.float64]
    Complex: TypeAlias = NDArray[np.complex128]

Excitation = Literal["auto", "hits", "random", "sweep"]
PRETRIGGER_S = 0.05
"""Of a window, before its hit: longer than any anti-alias filter rings ahead."""
BELOW_DB = 20.0
"""A hammer that is weaker by so much than at low frequencies no longer excites."""
ALIASING = 0.4
"""Share of the sampling rate up to which anti-alias filters are trusted."""
KEPT_NOTES = ("robot", "posture", "robot_yaml", "file", "coordinates")
"""Of a record those that hold for its frequency responses as well."""


@dataclass(frozen=True, eq=False, repr=False)
class FrfEstimate:
    """Frequency responses, and how they came from time records.

    Attributes:
        frfs: the responses, with coherence and averages.
        hits: all that were found, used or not; none of a shaker.
        excitation: "hits", "random" or "sweep".
        estimator: H1, H2 or Hv.
        window_s: length of the window of a hit, or of a block.
        force_spectrum: mean square of each force's transform over the lines of `frfs`, (L, inputs), N² s².
        remarks: what a user should know, in full sentences.
    """

    frfs: FrfSet
    hits: tuple[Hit, ...]
    excitation: str
    estimator: str
    window_s: float
    force_spectrum: Array
    remarks: tuple[str, ...]

    def __repr__(self) -> str:
        """Hits and responses in one line."""
        used = sum(hit.used for hit in self.hits)
        what = f"{used} of {len(self.hits)} hits" if self.hits else f"blocks of {self.window_s:g} s"
        return f"FrfEstimate({what}, {self.estimator}: {self.frfs!r})"


def estimate_frf(
    records: TimeSeries | Sequence[TimeSeries],
    *,
    excitation: Excitation = "auto",
    estimator: Estimator = "H1",
    window_s: float | None = None,
    resolution_hz: float | None = None,
    pretrigger_s: float = PRETRIGGER_S,
    force_window: bool = True,
    decay_rate: float | Literal["auto"] = "auto",
    trigger: float = 0.1,
    double_hit: float = 0.05,
    full_scale: Mapping[str, float] | None = None,
    max_hz: float | None = None,
    keep: Sequence[int] | None = None,
    overlap: float = 0.5,
    progress: Callable[[str], object] | None = None,
) -> FrfEstimate:
    """Frequency responses of a tap test or a shaker test.

    Args:
        records: with channels of force and response named PLACE.AXIS; those of a campaign may differ in them, as with a
            roving hammer or sensor. What was hit or watched in several of them is averaged.
        excitation: "hits" of a hammer, or a shaker's "random" force or "sweep", cut into blocks with a Hann window
            (Welch); "auto": as the force looks.
        estimator: see `estimators.frf_estimate`.
        window_s: length of each hit's window, or of a block; by default to the next hit or the end of the record, the
            shortest of all.
        resolution_hz: distance of the lines instead: one over the length.
        pretrigger_s: what of the window lies before the hit; less where the record begins later.
        force_window: take the force for zero after its contact, where there is only noise.
        decay_rate: a in 1/s of the exponential window e^(−at) on force and response; "auto": none for responses that
            decay to 1 % in their window, else what brings them there.
        trigger: share of a record's largest force that a hit exceeds.
        double_hit: share of its force from which on a second pulse makes a hit a double one.
        full_scale: of channels by pattern, in their units.
        max_hz: highest line; by default where the force has fallen by 20 dB, or 0.4 of the sampling rate.
        keep: indices of the hits to use, whatever is wrong with them.
        overlap: of the blocks of a shaker, a share.
        progress: called with the name of each stage.

    Raises:
        SignalError: records without force, response or hit, of different rates, or options that make no sense.
    """
    _refuse_odd(excitation, window_s, resolution_hz, pretrigger_s, decay_rate, trigger, double_hit, max_hz, overlap)
    length_s = 1 / resolution_hz if resolution_hz is not None else window_s
    given = as_records(records)
    usable, remarks = _usable(given)
    told_scales = full_scales([one.record for one in usable], full_scale)
    scales = {one.number: scale for one, scale in zip(usable, told_scales, strict=True)}
    rate = given[0].sample_rate_hz
    chosen = ("hits" if looks_like_hits(usable, trigger) else "random") if excitation == "auto" else excitation
    if progress is not None:
        progress("finding hits" if chosen == "hits" else "cutting blocks")
    hits: tuple[Hit, ...] = ()
    a, told = 0.0, list[str]()
    if chosen == "hits":
        hits, told = chosen_hits(usable, scales, trigger, double_hit, keep, length_s)
        samples, more = window_samples(hits, rate, length_s)
        a, of_decay = decay_of(usable, hits, samples, decay_rate)
        told += more + of_decay
        cut = all_tapped(usable, hits, samples, a, pretrigger_s=pretrigger_s, force_window=force_window)
    else:
        for name, value, otherwise in (("decay_rate", decay_rate, "auto"), ("keep", keep, None)):
            if value != otherwise:
                found = f"{value!r} with a {chosen} force"
                raise SignalError(name, found=found, expected="hits of a hammer, which alone have it")
        samples = block_samples(usable, length_s)
        cut, told = all_blocks(usable, samples, overlap)
    frfs, spectrum, more = _assembled(
        cut, np.asarray(np.fft.rfftfreq(samples, 1 / rate), np.float64), a, estimator, chosen, max_hz, given[0]
    )
    if bare := dict.fromkeys(label for one in usable for label in one.roles.unlabelled):
        more.append(f"No unit is stated for {', '.join(bare)}: taken for SI.")
    every = tuple(dict.fromkeys([*remarks, *told, *more]))
    return FrfEstimate(frfs, hits, chosen, estimator, samples / rate, spectrum, every)


def _refuse_odd(
    excitation: Any,
    window_s: Any,
    resolution_hz: Any,
    pretrigger_s: Any,
    decay_rate: Any,
    trigger: Any,
    double_hit: Any,
    max_hz: Any,
    overlap: Any,
) -> None:
    """Refuse arguments that make no sense by themselves."""
    if excitation not in get_args(Excitation):
        raise SignalError("excitation", found=repr(excitation), expected=f"one of {', '.join(get_args(Excitation))}")
    if window_s is not None and resolution_hz is not None:
        found = f"{resolution_hz!r} with window_s={window_s!r}"
        raise SignalError("resolution_hz", found=found, expected="one of them")

    def number(name: str, value: Any, expected: str, fits: Callable[[float], bool]) -> None:
        if (
            isinstance(value, bool)
            or not isinstance(value, Real)
            or not np.isfinite(float(value))
            or not fits(float(value))
        ):
            raise SignalError(name, found=repr(value), expected=expected)

    for name, value, unit in (
        ("window_s", window_s, "s"),
        ("resolution_hz", resolution_hz, "Hz"),
        ("max_hz", max_hz, "Hz"),
    ):
        if value is not None:
            number(name, value, f"a positive number of {unit}", lambda x: x > 0)
    number("pretrigger_s", pretrigger_s, "a time in s of at least 0", lambda x: x >= 0)
    number("overlap", overlap, "a share from 0 up to 1", lambda x: 0 <= x < 1)
    for name, value in (("trigger", trigger), ("double_hit", double_hit)):
        number(name, value, "a share between 0 and 1", lambda x: 0 < x < 1)
    if not (isinstance(decay_rate, str) and decay_rate == "auto"):
        number("decay_rate", decay_rate, '"auto" or a rate in 1/s of at least 0', lambda x: x >= 0)


def _usable(given: Sequence[TimeSeries]) -> tuple[list[Usable], list[str]]:
    """The records with forces and responses that say something, and what is to be said of the others.

    Raises:
        SignalError: there is none.
    """
    kept, remarks = [], []
    first: SignalError | None = None
    for k, record in enumerate(given):
        try:
            alive, told = _alive(record, k)
            kept.append(Usable(alive, k, roles(alive, k)))
            remarks += told
        except SignalError as error:
            first = first or error
            remarks.append(f"Record {k + 1} is left out: {error.found}.")
    if first is not None and not kept:
        raise first
    return kept, remarks


def _alive(record: TimeSeries, number: int) -> tuple[TimeSeries, list[str]]:
    """A record without forces and responses that never change, and their names in sentences.

    Raises:
        SignalError: it has no forces or no responses, or no such that change.
    """
    known = roles(record, number)
    still = {k for k, column in enumerate(record.values.T) if _is_still(column)}
    for columns in (known.forces, known.responses):
        if still.issuperset(columns):
            found = f"in {record.labels[columns[0]]} the same value throughout, or none that is a number"
            raise SignalError(f"records[{number}]", found=found, expected="signals")
    labels = [record.labels[k] for k in sorted(still & {*known.forces, *known.responses})]
    if not labels:
        return record, []
    told = [f"{label} never changes in record {number + 1}, or holds no numbers: it is left out." for label in labels]
    return record.select(*(label for label in record.labels if label not in labels)), told


def _is_still(column: Array) -> bool:
    finite = column[np.isfinite(column)]
    return bool(finite.size == 0 or np.ptp(finite) == 0)


def _assembled(
    blocks: Sequence[Block],
    freq_hz: Array,
    decay_rate: float,
    estimator: Estimator,
    excitation: str,
    max_hz: float | None,
    record: TimeSeries,
) -> tuple[FrfSet, Array, list[str]]:
    """One set of all pairs, the mean square of each force's transform, and what is to be said."""
    inputs = tuple(dict.fromkeys(label for block in blocks for label in block.inputs))
    outputs = tuple(dict.fromkeys(label for block in blocks for label in block.outputs))
    shape = (len(freq_hz), len(outputs), len(inputs))
    values, coherence = np.zeros(shape, np.complex128), np.zeros(shape)
    averages, force = np.zeros(shape[1:], np.int64), np.zeros((len(freq_hz), len(inputs)))
    enough = True
    for hit in dict.fromkeys(block.inputs for block in blocks):
        columns = [inputs.index(label) for label in hit]
        own = [block for block in blocks if block.inputs == hit]
        force[:, columns] = np.mean([np.abs(block.forces) ** 2 for block in own], axis=0)
        for label in dict.fromkeys(label for block in own for label in block.outputs):
            seen = [block for block in own if label in block.outputs]
            row = outputs.index(label)
            F = np.array([block.forces for block in seen])
            Y = np.array([block.responses[:, [block.outputs.index(label)]] for block in seen])
            H, gamma = frf_estimate(F, Y, estimator)
            values[:, row, columns], coherence[:, row, columns] = H[:, 0], gamma
            averages[row, columns] = len(seen)
            enough &= len(seen) > len(hit)
    remarks = []
    if not enough:
        remarks.append("One average only for some responses: no coherence, and noise is judged by the fit.")
    rate = record.sample_rate_hz
    if max_hz is not None and not freq_hz[1] <= max_hz <= rate / 2:
        raise SignalError("max_hz", found=repr(max_hz), expected=f"{freq_hz[1]:g} to {rate / 2:g} Hz")
    if excitation == "hits":
        low, top = freq_hz[1], max(_highest(freq_hz, force, rate), freq_hz[1])
    else:
        low, top = excited(force, freq_hz, ALIASING * rate if max_hz is None else max_hz)
        if low > 2 * freq_hz[1] or (max_hz is None and top < 0.9 * ALIASING * rate):
            remarks.append(f"The forces excite {low:.4g} to {top:.4g} Hz.")
    used = (freq_hz >= low) & (freq_hz <= (top if max_hz is None else max_hz))
    frfs = FrfSet(
        freq_hz[used], values[used], KINDS[2], outputs, inputs,
        coherence=coherence[used] if enough else None, averages=averages, measured=averages > 0, decay_rate=decay_rate,
        notes={name: record.notes[name] for name in KEPT_NOTES if name in record.notes},
    )  # fmt: skip
    return frfs, force[used], remarks


def _highest(freq_hz: Array, force: Array, rate: float) -> float:
    """Up to where all hits excite and nothing is aliased."""
    top = ALIASING * rate
    level = 10 * np.log10(np.maximum(force, np.finfo(float).tiny))
    low = max(len(level) // 20, 1)
    reference = level[1 : low + 1].max(axis=0)
    weak = np.flatnonzero((level < reference - BELOW_DB).any(axis=1) & (freq_hz > freq_hz[low]))
    return min(top, float(freq_hz[weak[0]])) if weak.size else top
