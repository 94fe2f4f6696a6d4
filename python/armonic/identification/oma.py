"""Operational modal analysis: from a time series to modes, through poles of many model orders and their selection."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias, get_args

import numpy as np

from armonic.errors import SignalError
from armonic.identification.autoregressive import vector_autoregression
from armonic.identification.clustering import select_modes
from armonic.identification.combinations import without_combinations
from armonic.identification.grid_search import grid_search
from armonic.identification.harmonics import Flag, flags
from armonic.identification.preprocessing import decimate as decimated
from armonic.identification.preprocessing import detrend as detrended
from armonic.identification.preprocessing import free_decay
from armonic.identification.samples import checked_orders
from armonic.identification.sharpening import sharpened
from armonic.identification.stabilization import Criteria, Stabilization, stabilize
from armonic.identification.subspace import covariance_ssi
from armonic.series import FREE_FROM, TimeSeries

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from armonic.identification.poles import ModelPoles
    from armonic.identification.selection import RejectedMode, SelectedMode
    from armonic.simulation.running import Run

    Array: TypeAlias = NDArray[np.float64]

Method = Literal["var", "ssi"]
"""Vector autoregression, or covariance-driven stochastic subspace identification."""
Window = Literal["auto", "decay", "all"]
Offset = Literal["auto", "none", "mean", "linear", "rest"]
PREFERRED = ("motor_position", "joint_position", "acceleration", "velocity", "displacement")
"""Quantities to identify from where none is asked for; the first that the series has."""
MOST_ORDERS, STATES_PER_CHANNEL = 100, 20
"""Largest order where none is asked for; of subspace models, where more states than motion repeat false poles."""
LATEST_START = 0.8
"""Share of the samples by which forces must have come to rest for the remainder to count as a decay."""
TWINS = 1e-13
"""Channels whose correlation is this close to one say the same; no model of both is determined."""
SPACING = 4
"""Lags of the second set are so many samples apart where nothing is asked."""
SINE = 1e-4
"""Nothing on a robot is damped by less than this."""
DAMPED = 0.005
"""Damping ratio above which nothing is a harmonic: a sine has none."""


@dataclass(frozen=True, eq=False, repr=False)
class OmaResult:
    """The modes of a response, and everything they were chosen from.

    Attributes:
        method: how the poles were found.
        series: the samples used: channels, window and offset as they were identified.
        window: "decay" if the free decay after the excitation was taken, else "all" or the times.
        orders: first and last model order.
        stabilization: the poles of all orders.
        modes: those selected, by natural frequency.
        rejected: groups of poles that hold over the orders and are no modes, with the reason.
        channels: labels of the channels, the entries of every shape.
        harmonics: per mode, whether it is one of a machine that turned meanwhile.
        spacing: per mode, samples from one lag to the next in the autoregressions that its pole and shape come from.
        seconds: how long it took.
    """

    method: Method
    series: TimeSeries
    window: str
    orders: tuple[int, int]
    stabilization: Stabilization
    modes: tuple[SelectedMode, ...]
    rejected: tuple[RejectedMode, ...]
    channels: tuple[str, ...]
    harmonics: tuple[Flag, ...]
    spacing: tuple[int, ...]
    seconds: float

    def __repr__(self) -> str:
        """How many modes, and out of what, in one line."""
        return (
            f"OmaResult({len(self.modes)} modes by {self.method} of orders {self.orders[0]} to {self.orders[1]}, "
            f"{len(self.series)} samples of {len(self.channels)} channels)"
        )

    @property
    def natural_freq_hz(self) -> Array:
        """|λ| / 2π of each mode, (modes,)."""
        return np.array([mode.natural_freq_hz for mode in self.modes])

    @property
    def damping_ratio(self) -> Array:
        """−Re λ / |λ| of each mode, (modes,), a fraction."""
        return np.array([mode.damping_ratio for mode in self.modes])


def oma(
    series: TimeSeries | Run,
    *,
    channels: str | Sequence[str] | None = None,
    orders: range | tuple[int, int] | None = None,
    method: Method | Literal["auto"] = "auto",
    window: Window | tuple[float, float] = "auto",
    detrend: Offset = "auto",
    decimate: int = 1,
    band_hz: tuple[float, float] | None = None,
    criteria: Criteria | None = None,
    selection: Literal["cluster", "grid"] = "cluster",
    freq_resolution_hz: float = 0.1,
    damping_resolution: float = 0.001,
    repeats: int | None = None,
    spindle_hz: float | None = None,
    block_rows: int | None = None,
    deviations: bool = False,
    spacing: int | None = None,
    progress: Callable[[str], object] | None = None,
) -> OmaResult:
    """Modes from responses alone (Do et al. 2022, section 4.3): poles of every model order, then those that are modes.

    Args:
        series: the response; a channel of force, if there is one, says where the free decay begins.
        channels: what to identify from: quantities, names, labels or shell patterns; by default motor positions, or
            what else there is of motion.
        orders: model orders: lags of an autoregression, states of a subspace model; by default 2 to 100, or as many as
            the samples allow, for "ssi" 20 per channel at most.
        method: "var" or "ssi"; "auto" takes "var" for a free decay, to which it fits exactly, and "ssi" for a response
            to lasting excitation, of which it needs fewer orders.
        window: "decay": from where the last force ends, or from the greatest response; "all"; (start, stop) in s;
            "auto": from where the forces no longer change, if they do so before the end, else all.
        detrend: what is taken off each channel, see `preprocessing.detrend`; "auto": where a decay ends, else the mean.
        decimate: how many samples become one, after a low-pass filter.
        band_hz: natural frequencies that are looked at; all if not given.
        criteria: what makes a pole stable in the stabilization diagram.
        selection: "cluster" needs no threshold; "grid" is that of the paper's tool, with the three that follow.
        freq_resolution_hz: width of a cell of the grid.
        damping_resolution: height of a cell, a fraction.
        repeats: least number of orders in a cell; half of them if not given.
        spindle_hz: turns per second of a machine that ran; its harmonics are flagged.
        block_rows: of the covariances of "ssi"; by default as many as the orders need, 30 at least.
        deviations: for "var", also the standard deviation of each pole (`stabilization.freq_std_hz`).
        spacing: for "var", a second set of autoregressions whose lags are so many samples apart sharpens the slow modes
            that the first set finds; 1: none; by default four samples for a decay that is long enough.
        progress: called with the name of each stage; what it raises ends the work.

    Raises:
        SignalError: channels, window, orders or samples make no sense; it says the largest order that is possible.
    """
    began = time.perf_counter()
    series = _series(series)
    _refuse_odd(method, window, detrend, selection)
    say = progress or (lambda stage: None)
    say("preparing the samples")
    patterns = _patterns(series, channels)
    cut, taken, free = _cut(series, patterns, window)
    used = _without_offset(cut, detrend, free=free)
    used = decimated(used, decimate)
    _refuse_idle(used)
    chosen_method: Method = method if method != "auto" else "var" if free else "ssi"
    orders = _default_orders(used, chosen_method) if orders is None else orders
    listed = checked_orders(orders, step=1 if chosen_method == "var" else 2)
    say(f"poles of orders {listed[0]} to {listed[-1]}")
    models = _poles(used, chosen_method, orders, band_hz, block_rows, deviations)
    say("comparing orders")
    stabilization = stabilize(models, _within(criteria, band_hz))
    say("selecting modes")
    if selection == "cluster":
        chosen = select_modes(stabilization)
    else:
        grid = grid_search(
            stabilization,
            freq_resolution_hz=freq_resolution_hz,
            damping_resolution=damping_resolution,
            repeats=repeats,
        )
        chosen = without_combinations(grid)
    inside = tuple(mode for mode in chosen.modes if _inside(mode.natural_freq_hz, band_hz))
    apart = _spacing(used, chosen_method, listed[-1], spacing, decay=free)
    spacings = (1,) * len(inside)
    if apart > 1:
        say(f"sharpening slow modes with lags {apart} samples apart")
        slow = vector_autoregression(used.values, used.sample_rate_hz, orders=orders, band_hz=band_hz, spacing=apart)
        inside, spacings = sharpened(inside, slow, used.sample_rate_hz, apart)
    return OmaResult(
        method=chosen_method,
        series=used,
        window=taken,
        orders=(listed[0], listed[-1]),
        stabilization=stabilization,
        modes=inside,
        rejected=tuple(mode for mode in chosen.rejected if _inside(mode.natural_freq_hz, band_hz)),
        channels=used.labels,
        harmonics=_harmonics(used, inside, spindle_hz, decay=free),
        spacing=spacings,
        seconds=time.perf_counter() - began,
    )


def _refuse_odd(method: str, window: object, detrend: str, selection: str) -> None:
    for name, value, words in (
        ("method", method, ("auto", *get_args(Method))),
        ("detrend", detrend, get_args(Offset)),
        ("selection", selection, ("cluster", "grid")),
    ):
        if value not in words:
            raise SignalError(name, found=repr(value), expected=f"one of {', '.join(words)}")
    if isinstance(window, str) and window not in get_args(Window):
        expected = f"one of {', '.join(get_args(Window))}, or (start, stop) in s"
        raise SignalError("window", found=repr(window), expected=expected)


def _series(given: TimeSeries | Run) -> TimeSeries:
    """The series, or that of a run."""
    series = getattr(given, "series", given)
    if not isinstance(series, TimeSeries):
        raise SignalError("series", found=f"a {type(given).__name__}", expected="a TimeSeries, or a Run")
    return series


def _default_orders(series: TimeSeries, method: Method) -> tuple[int, int]:
    """2 to 100, or what the samples and channels are good for."""
    channels = len(series.channels)
    if method == "ssi":
        return 2, max(2, min(MOST_ORDERS, STATES_PER_CHANNEL * channels, len(series) // 4))
    return 2, max(2, min(MOST_ORDERS, int(0.8 * len(series) / (channels + 1))))


def _patterns(series: TimeSeries, channels: str | Sequence[str] | None) -> tuple[str, ...]:
    if isinstance(channels, str):
        return (channels,)
    if channels is not None:
        if not isinstance(channels, Sequence):
            raise SignalError("channels", found=repr(channels), expected="patterns of channels")
        return tuple(channels)
    quantities = {channel.quantity for channel in series.channels}
    for quantity in PREFERRED:
        if quantity in quantities:
            return (quantity,)
    rest = tuple(c.label for c in series.channels if c.quantity not in ("force", "energy", "power"))
    if not rest:
        raise SignalError("channels", found="no channel of motion", expected="at least one", hint="Name the channels.")
    return rest


def _cut(
    series: TimeSeries, patterns: tuple[str, ...], window: Window | tuple[float, float]
) -> tuple[TimeSeries, str, bool]:
    """The channels within the window, what the window is, and whether nothing drives the robot there."""
    chosen = series.select(*patterns)
    forces = [k for k, channel in enumerate(series.channels) if channel.quantity == "force"]
    since = _free_from(series, forces)
    if not isinstance(window, str):
        try:
            start, stop = (float(edge) for edge in window)
        except (TypeError, ValueError) as error:
            raise SignalError("window", found=repr(window), expected="(start, stop) in s") from error
        return chosen.window(start, stop), f"{start:g} to {stop:g} s", series.start_s < since <= start
    ends = series.start_s < since <= series.start_s + LATEST_START * series.duration_s
    if window == "all" or (window == "auto" and not ends):
        return chosen, "all", False
    if ends:
        return chosen.window(since), "decay", True
    shown = series.select(*chosen.labels, *(series.labels[k] for k in forces))
    return free_decay(shown).select(*chosen.labels), "decay", True


def _free_from(series: TimeSeries, forces: list[int]) -> float:
    """When forces have come to rest, s; the start of the series if none is known to act.

    A force that stays, as a step does, leaves the robot as free as one that ends.
    """
    changes = np.flatnonzero(np.diff(series.values[:, forces], axis=0).any(axis=1)) + 1
    since = series.start_s + (int(changes[-1]) / series.sample_rate_hz if changes.size else 0.0)
    if FREE_FROM in series.notes:  # by a simulation, whose pulses may lie between samples
        since = max(since, float(series.notes[FREE_FROM]) - 1e-9 / series.sample_rate_hz)
    return since


def _without_offset(series: TimeSeries, detrend: Offset, *, free: bool) -> TimeSeries:
    if detrend == "none":
        series.finite()
        return series
    if detrend == "auto":
        return detrended(series, "rest" if free else "mean")
    return detrended(series, detrend)


def _refuse_idle(series: TimeSeries) -> None:
    still = np.flatnonzero(np.ptp(series.values, axis=0) == 0)
    if len(still):
        raise SignalError(
            series.labels[still[0]],
            found=f"the same value in all {len(series)} samples",
            expected="a signal",
            hint="Leave the channel out.",
        )
    centred = series.values - series.values.mean(axis=0)
    alike = np.abs(np.corrcoef(centred, rowvar=False)).reshape(len(series.channels), -1)
    twins = np.argwhere(np.triu(alike > 1 - TWINS, 1))
    if len(twins):
        a, b = (series.labels[int(i)] for i in twins[0])
        raise SignalError(b, found=f"the same signal as {a}", expected="every signal once", hint="Leave one out.")


def _poles(
    series: TimeSeries,
    method: Method,
    orders: range | tuple[int, int],
    band_hz: tuple[float, float] | None,
    block_rows: int | None,
    deviations: bool,
) -> list[ModelPoles]:
    rate = series.sample_rate_hz
    if method == "var":
        return vector_autoregression(series.values, rate, orders=orders, band_hz=band_hz, deviations=deviations)
    if deviations:
        raise SignalError("deviations", found="True with ssi", expected='method="var"')
    if block_rows is None:
        last = checked_orders(orders, step=2)[-1]
        block_rows = max(math.ceil(last / len(series.channels)) + 1, 30)
    return covariance_ssi(series.values, rate, orders=orders, block_rows=block_rows, band_hz=band_hz)


def _spacing(series: TimeSeries, method: Method, last: int, spacing: int | None, *, decay: bool) -> int:
    """Samples between the lags of the second set; 1 for none."""
    if spacing is not None:
        if not (isinstance(spacing, int) and spacing >= 1):
            raise SignalError("spacing", found=repr(spacing), expected="a whole number of at least 1, or None")
        if method != "var" and spacing != 1:
            raise SignalError("spacing", found=f"{spacing} with ssi", expected='method="var"')
        return spacing
    long_enough = len(series) >= 2 * (len(series.channels) + SPACING) * last
    return SPACING if method == "var" and decay and long_enough else 1


def _within(criteria: Criteria | None, band_hz: tuple[float, float] | None) -> Criteria:
    return criteria if criteria is not None else Criteria(freq_range_hz=band_hz)


def _inside(freq_hz: float, band_hz: tuple[float, float] | None) -> bool:
    return band_hz is None or band_hz[0] <= freq_hz <= band_hz[1]


def _harmonics(
    series: TimeSeries, modes: Sequence[SelectedMode], spindle_hz: float | None, *, decay: bool
) -> tuple[Flag, ...]:
    """A flag per mode; only modes that could be a sine are looked at."""
    if decay and spindle_hz is None:
        return tuple(Flag(m.natural_freq_hz, False, "a free decay has no harmonics", math.nan) for m in modes)
    found = []
    for mode in modes:
        f, damping = mode.natural_freq_hz, mode.damping_ratio
        if abs(damping) < SINE and not decay:
            found.append(Flag(f, True, "no damping at all, as of a sine", math.nan))
        elif damping > DAMPED or f >= series.sample_rate_hz / 2:
            found.append(Flag(f, False, f"damped by {100 * damping:.2g} %", math.nan))
        else:
            found.extend(flags(series, [f], spindle_hz, damping_ratio=[damping]))
    return tuple(found)
