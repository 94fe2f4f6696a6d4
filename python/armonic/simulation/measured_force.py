"""A force as it was measured, as an excitation of a run."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar, TypeAlias

import numpy as np

from armonic.errors import SimulationError
from armonic.simulation.excitations import Excitation, refuse_unless

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from armonic.series import TimeSeries
    from armonic.simulation.excitations import Waveform

    Array: TypeAlias = NDArray[np.float64]

FORCE_UNITS = {
    "": {"N": 1.0, "N m": 1.0},
    "N": {"N": 1.0},
    "mN": {"N": 1e-3},
    "kN": {"N": 1e3},
    "lbf": {"N": 4.4482216152605},
    "N m": {"N m": 1.0},
    "Nm": {"N m": 1.0},
    "N·m": {"N m": 1.0},
}
"""What a measured force may be in, and its factor to SI."""


@dataclass(frozen=True, kw_only=True, eq=False)
class MeasuredForce(Excitation):
    """A force as it was measured: even samples joined by straight lines.

    Attributes:
        values: (samples,) N or N m.
        sample_rate_hz: samples per second.
        start_s: when the first sample acts.
        ends_early: whether the force may end before the run, which then goes on without it.
    """

    values: ArrayLike = field(repr=False)
    sample_rate_hz: float
    start_s: float = 0.0
    ends_early: bool = False

    name: ClassVar[str] = "MeasuredForce"

    @classmethod
    def of(
        cls,
        series: TimeSeries,
        channel: str = "force",
        *,
        axis: str,
        frame: str | None = None,
        ends_early: bool = False,
    ) -> MeasuredForce:
        """A channel of a time series.

        Args:
            series: the measurement; its first sample acts at the start of the run.
            channel: name, quantity or label of one channel.
            axis: as in `Excitation`.
            frame: as in `Excitation`.
            ends_early: whether the force may end before the run.

        Raises:
            SignalError: not exactly one channel is meant.
        """
        unit = series.channels[series.index(channel)].unit
        wanted = "N m" if axis.startswith("r") else "N"
        factor = FORCE_UNITS.get(unit, {}).get(wanted)
        if factor is None:
            expected = f"{wanted} or a multiple of it, or no unit"
            raise SimulationError(f"{cls.name}, channel {channel}", found=f"values in {unit!r}", expected=expected)
        return cls(
            axis=axis,
            frame=frame,
            values=factor * series[channel],
            sample_rate_hz=series.sample_rate_hz,
            ends_early=ends_early,
        )

    def _check(self) -> None:
        refuse_unless(self, "sample_rate_hz", above=0.0)
        refuse_unless(self, "start_s", least=0.0)
        try:
            values = self.samples
        except (TypeError, ValueError) as error:
            raise SimulationError(f"{self.name}.values", found=f"{error}", expected="finite numbers") from error
        if values.ndim != 1 or values.size < 2:
            raise SimulationError(f"{self.name}.values", found=f"shape {values.shape}", expected="two samples or more")
        if not np.isfinite(values).all():
            sample = int(np.argmin(np.isfinite(values)))
            found = f"{values[sample]} at sample {sample}"
            raise SimulationError(f"{self.name}.values", found=found, expected="finite numbers")

    @cached_property
    def samples(self) -> Array:
        """The values as an array, (samples,)."""
        return np.asarray(self.values, np.float64)

    def waveform(self, duration_s: float) -> Waveform:
        """The samples.

        Raises:
            SimulationError: they end before the run does, and may not.
        """
        end = self.start_s + (self.samples.size - 1) / self.sample_rate_hz
        if end < duration_s - 1.5 / self.sample_rate_hz and not self.ends_early:
            raise SimulationError(
                self.name,
                found=f"a force that ends at {end:g} s",
                expected=f"one for the whole run of {duration_s:g} s",
                hint="Shorten the run, or say that the force may end early.",
            )
        return "samples", [self.start_s, 1 / self.sample_rate_hz], self.samples.tolist()
