"""From time records to frequency responses: of hammers by hits, of shakers by blocks."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, TypeAlias, get_args

import numpy as np

from armonic.errors import SignalError
from armonic.experiment.contacts import at_rest, contacts
from armonic.experiment.estimators import Estimator, frf_estimate
from armonic.experiment.hits import BEFORE_S, NO_NUMBERS, Hit, find_hits
from armonic.experiment.signals import as_records, full_scales, roles
from armonic.frf_set import FrfSet
from armonic.response import KINDS

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from armonic.series import TimeSeries

    Array: TypeAlias = NDArray[np.float64]
    Complex: TypeAlias = NDArray[np.complex128]

Excitation = Literal["auto", "hits", "random", "sweep"]
DECAYED = 0.01
"""What a response should have come down to at the end of its window."""
PRETRIGGER_S = 0.05
BELOW_DB = 20.0
"""A force that is weaker by so much no longer excites."""
ALIASING = 0.4
"""Share of the sampling rate up to which anti-alias filters are trusted."""
LEAST_SAMPLES = 16
"""Of a window."""
BLOCKS = 8
"""Blocks without overlap that a record of a shaker is cut into where nothing is asked."""


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


@dataclass(frozen=True, eq=False)
class _Block:
    """Spectra of one hit or block: of its forces (L, inputs) and responses (L, outputs), as accelerations or alike."""

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    forces: Complex
    responses: Complex


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
    given, remarks = _usable(as_records(records))
    if excitation not in get_args(Excitation):
        raise SignalError("excitation", found=repr(excitation), expected=f"one of {', '.join(get_args(Excitation))}")
    if resolution_hz is not None:
        if window_s is not None or not resolution_hz > 0:
            found = f"{resolution_hz!r} with window_s={window_s!r}"
            raise SignalError("resolution_hz", found=found, expected="a positive number of Hz, without window_s")
        window_s = 1 / resolution_hz
    if window_s is not None and not window_s > 0:
        raise SignalError("window_s", found=repr(window_s), expected="a positive time in s")
    if decay_rate != "auto" and not (isinstance(decay_rate, int | float) and 0 <= decay_rate < np.inf):
        raise SignalError("decay_rate", found=repr(decay_rate), expected='"auto" or a rate in 1/s of at least 0')
    if not 0 <= pretrigger_s < np.inf:
        raise SignalError("pretrigger_s", found=repr(pretrigger_s), expected="a time in s of at least 0")
    if not 0 <= overlap < 1:
        raise SignalError("overlap", found=repr(overlap), expected="a share from 0 up to 1")
    scales = full_scales(given, full_scale)
    chosen = _looks_like(given, trigger) if excitation == "auto" else excitation
    if progress is not None:
        progress("finding hits" if chosen == "hits" else "cutting blocks")
    hits: tuple[Hit, ...] = ()
    if chosen == "hits":
        hits, told = _hits(given, scales, trigger, double_hit, keep)
        remarks += told
        samples, rate = _window(given, hits, window_s, remarks)
        a, told = _decay(given, hits, samples, decay_rate)
        remarks += told
        cut = [_tapped(given[h.record], h, samples, a, pretrigger_s, force_window) for h in hits if h.used]
    else:
        rate, a = given[0].sample_rate_hz, 0.0
        length = window_s if window_s is not None else min(len(r) for r in given) / rate / BLOCKS
        samples = round(length * rate)
        if samples < LEAST_SAMPLES:
            raise SignalError("window_s", found=f"{length:g} s", expected=f"at least {LEAST_SAMPLES / rate:g} s")
        cut = [block for k, record in enumerate(given) for block in _blocks(record, k, samples, overlap)]
        if not cut:
            found = f"records shorter than {length:g} s"
            raise SignalError("window_s", found=found, expected="blocks that the records hold")
    frfs, spectrum = _assembled(cut, np.fft.rfftfreq(samples, 1 / rate), a, estimator, remarks, rate, max_hz)
    for number, record in enumerate(given):
        if bare := roles(record, number).unlabelled:
            remarks.append(f"No unit is stated for {', '.join(bare)}: taken for SI.")
            break
    notes = {k: v for k, v in given[0].notes.items() if k in ("robot", "posture", "robot_yaml", "file", "coordinates")}
    return FrfEstimate(
        replace(frfs, notes=notes), hits, chosen, estimator, samples / rate, spectrum, tuple(dict.fromkeys(remarks))
    )


def _usable(given: tuple[TimeSeries, ...]) -> tuple[tuple[TimeSeries, ...], list[str]]:
    """The records with forces and responses, and what is to be said of the others.

    Raises:
        SignalError: there is none.
    """
    kept, remarks = [], []
    first: SignalError | None = None
    for k, record in enumerate(given):
        try:
            roles(record, k)
        except SignalError as error:
            first = first or error
            remarks.append(f"Record {k + 1} is left out: {error.found}.")
        else:
            kept.append(record)
    if first is not None and not kept:
        raise first
    return tuple(kept), remarks


def _looks_like(records: Sequence[TimeSeries], trigger: float) -> str:
    """Hits where contacts fill less than a tenth of the time."""
    record = records[0]
    column = roles(record, 0).forces[0]
    free, noise = at_rest(record.values[:, column], record.sample_rate_hz)
    found = contacts(free, noise, record.sample_rate_hz, trigger)
    busy = sum(contact.samples for contact in found)
    loud = np.mean(np.abs(free) > 0.05 * np.abs(free).max(initial=0.0))
    return "hits" if found and busy < 0.1 * len(record) and loud < 0.1 else "random"


def _hits(
    records: Sequence[TimeSeries],
    scales: Sequence[dict[int, float]],
    trigger: float,
    double_hit: float,
    keep: Sequence[int] | None,
) -> tuple[tuple[Hit, ...], list[str]]:
    found: list[Hit] = []
    remarks = []
    for k, record in enumerate(records):
        hits = find_hits(record, number=k, trigger=trigger, double_hit=double_hit, full_scale=scales[k])
        if not hits:
            remarks.append(f"Record {k + 1} holds no hit.")
        found += hits
    if not found:
        known = roles(records[0])
        names = ", ".join(records[0].labels[c] for c in known.forces)
        raise SignalError("records", found=f"no hit in {names}", expected="pulses of a hammer", hint="See excitation=.")
    if keep is not None:
        wrong = [k for k in keep if not 0 <= k < len(found)]
        if wrong or not len(keep):
            said = f"index {wrong[0]}" if wrong else "none"
            raise SignalError("keep", found=said, expected=f"indices of {len(found)} hits, 0 to {len(found) - 1}")
        bad = [k for k in keep if NO_NUMBERS in found[k].reason]
        if bad:
            raise SignalError("keep", found=f"index {bad[0]}: {found[bad[0]].reason}", expected="hits of numbers")
        found = [replace(h, used=k in keep, reason=h.reason if k in keep else "left out") for k, h in enumerate(found)]
    used = [hit for hit in found if hit.used]
    if not used:
        listed = "; ".join(f"hit {k}: {hit.reason}" for k, hit in enumerate(found[:4], 1))
        raise SignalError(
            "records", found=f"no usable hit ({listed})", expected="one at least", hint="keep= uses hits all the same."
        )
    return tuple(found), remarks


def _window(
    records: Sequence[TimeSeries], hits: Sequence[Hit], asked_s: float | None, remarks: list[str]
) -> tuple[int, float]:
    """Samples of the window of every hit, and the sampling rate."""
    rate = records[0].sample_rate_hz
    room = {k: hit.stop - hit.first for k, hit in enumerate(hits) if hit.used}
    least, most = min(room.values()), max(room.values())
    if asked_s is None:
        if most > 1.1 * least:
            remarks.append(
                f"Windows of {least / rate:.3g} s, the shortest from a hit to the next; others have"
                f" {most / rate:.3g} s."
            )
        return least, rate
    samples = round(asked_s * rate)
    if samples > least + round(PRETRIGGER_S * rate):
        k = min(room, key=lambda key: room[key])
        raise SignalError(
            "window_s",
            found=f"{asked_s:g} s, where hit {k + 1} is followed by {room[k] / rate:.4g} s",
            expected=f"at most {least / rate:.4g} s",
            hint=f"Lines come no closer than {rate / least:.3g} Hz then.",
        )
    if samples < LEAST_SAMPLES:
        raise SignalError("window_s", found=f"{asked_s:g} s", expected=f"at least {LEAST_SAMPLES / rate:g} s")
    return samples, rate


def _decay(
    records: Sequence[TimeSeries], hits: Sequence[Hit], samples: int, asked: float | str
) -> tuple[float, list[str]]:
    """The rate of the exponential window, and what is to be said of it."""
    rate = records[0].sample_rate_hz
    if not isinstance(asked, str):
        return float(asked), []
    left = 0.0
    for hit in hits:
        if not hit.used:
            continue
        record = records[hit.record]
        known = roles(record, hit.record)
        values = record.values[:, known.responses] * known.factors[list(known.responses)]
        stop = min(hit.first + samples, hit.stop)
        values = values[hit.first : stop] - values[max(hit.first - round(BEFORE_S * rate), 0) : hit.first + 1].mean(
            axis=0
        )
        part = max(len(values) // 20, 2)
        start, end = (np.sqrt((side**2).mean(axis=0)) for side in (values[:part], values[-part:]))
        k = int(np.argmax(start))
        left = max(left, float(end[k] / start[k]) if start[k] > 0 else 0.0)
    if left <= DECAYED:
        return 0.0, []
    a = float(np.log(left / DECAYED) * rate / samples)
    return a, [
        f"Responses have {100 * left:.2g} % left at the end of their windows: an exponential window of {a:.3g}/s brings"
        " that to 1 %; what it adds to damping is taken off the modes."
    ]


def _tapped(record: TimeSeries, hit: Hit, samples: int, a: float, pretrigger_s: float, force_window: bool) -> _Block:
    """Spectra of force and responses in the window of a hit."""
    rate, known = record.sample_rate_hz, roles(record, hit.record)
    column = known.forces[known.inputs.index(hit.force)]
    start = max(hit.first - round(pretrigger_s * rate), 0)
    stop = min(start + samples, hit.stop)
    time_s = np.arange(stop - start) / rate
    force = at_rest(record.values[:, column], rate)[0][start:stop] * known.factors[column]
    if force_window:
        reach = 4 * (hit.last + 1 - hit.first)  # the ringing of an anti-alias filter belongs to the pulse
        span = np.arange(start, stop)
        beyond = np.maximum(np.maximum(hit.first - reach - span, span - hit.last - reach), 0)
        force = force * np.where(beyond < reach, 0.5 + 0.5 * np.cos(np.pi * np.minimum(beyond / reach, 1)), 0.0)
    columns = list(known.responses)
    rest = record.values[max(hit.first - round(BEFORE_S * rate), 0) : max(hit.first, 1)][:, columns]
    responses = (record.values[start:stop][:, columns] - rest.mean(axis=0)) * known.factors[columns]
    fall = np.exp(-a * time_s)
    F = np.fft.rfft(force * fall, samples)[:, None] / rate
    Y = np.fft.rfft(responses * fall[:, None], samples, axis=0) / rate
    return _Block((hit.force,), known.outputs, F, _alike(Y, known.powers, np.fft.rfftfreq(samples, 1 / rate), a))


def _blocks(record: TimeSeries, number: int, samples: int, overlap: float) -> list[_Block]:
    """Spectra of the blocks of a shaker's record, with a Hann window; blocks with values that are none are left out."""
    rate, known = record.sample_rate_hz, roles(record, number)
    hann = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(samples) / samples)
    columns = [*known.forces, *known.responses]
    freq, n, found = np.fft.rfftfreq(samples, 1 / rate), len(known.forces), []
    for start in range(0, len(record) - samples + 1, max(1, round((1 - overlap) * samples))):
        part = record.values[start : start + samples, columns] * known.factors[columns]
        if not np.isfinite(part).all():
            continue
        spectra = np.fft.rfft((part - part.mean(axis=0)) * hann[:, None], axis=0) / rate
        responses = _alike(spectra[:, n:], known.powers, freq, 0.0)
        found.append(_Block(known.inputs, known.outputs, spectra[:, :n], responses))
    return found


def _alike(spectra: Complex, powers: Sequence[int], freq_hz: ArrayLike, a: float) -> Complex:
    """Responses as accelerations."""
    s = 2j * np.pi * np.asarray(freq_hz) + a
    return np.asarray(spectra * np.stack([s ** (2 - power) for power in powers], axis=1))


def _assembled(
    blocks: Sequence[_Block],
    lines_hz: ArrayLike,
    a: float,
    estimator: Estimator,
    remarks: list[str],
    rate: float,
    max_hz: float | None,
) -> tuple[FrfSet, Array]:
    """One set of all pairs, and the mean autospectrum of each force."""
    freq_hz = np.asarray(lines_hz, np.float64)
    inputs = tuple(dict.fromkeys(label for block in blocks for label in block.inputs))
    outputs = tuple(dict.fromkeys(label for block in blocks for label in block.outputs))
    shape = (len(freq_hz), len(outputs), len(inputs))
    values, coherence = np.zeros(shape, np.complex128), np.zeros(shape)
    averages, force = np.zeros(shape[1:], np.int64), np.zeros((len(freq_hz), len(inputs)))
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
    measured = averages > 0
    known = bool((averages[measured] > len(blocks[0].inputs)).all())
    if not known:
        remarks.append("One average only for some responses: no coherence, and noise is judged by the fit.")
    if max_hz is not None and not freq_hz[1] <= max_hz <= rate / 2:
        expected = f"{freq_hz[1]:g} to {rate / 2:g} Hz"
        raise SignalError("max_hz", found=repr(max_hz), expected=expected)
    top = max(_highest(freq_hz, force, rate), freq_hz[1]) if max_hz is None else max_hz
    used = (freq_hz > 0) & (freq_hz <= top)
    frfs = FrfSet(
        freq_hz[used], values[used], KINDS[2], outputs, inputs,
        coherence=coherence[used] if known else None, averages=averages, measured=measured, decay_rate=a,
    )  # fmt: skip
    return frfs, force[used]


def _highest(freq_hz: Array, force: Array, rate: float) -> float:
    """Up to where all forces excite and nothing is aliased."""
    top = ALIASING * rate
    level = 10 * np.log10(np.maximum(force, np.finfo(float).tiny))
    reference = level[1 : max(len(level) // 20, 2)].max(axis=0)
    weak = np.flatnonzero((level < reference - BELOW_DB).any(axis=1) & (freq_hz > freq_hz[max(len(freq_hz) // 20, 1)]))
    return min(top, float(freq_hz[weak[0]])) if weak.size else top
