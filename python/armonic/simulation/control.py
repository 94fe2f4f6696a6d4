"""Control by a computer: torques found at even instants, late, from encoders with steps."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from armonic.errors import SimulationError


@dataclass(frozen=True, kw_only=True)
class SampledControl:
    """The control law of the robot file as a computer runs it: sampled, held and delayed.

    Attributes:
        rate_hz: instants per second at which positions are read and torques found.
        delay_s: from an instant until its torques act.
        velocity: "difference" takes the velocity from the last two positions, as a controller with encoders does;
            "measured" takes the true one.
        encoder_bits: steps of the motors' encoders, 2^bits for one turn of the rotor, ahead of the gear; None: exact.
    """

    rate_hz: float
    delay_s: float = 0.0
    velocity: Literal["difference", "measured"] = "difference"
    encoder_bits: int | None = None

    def __post_init__(self) -> None:
        if not (is_number(self.rate_hz) and self.rate_hz > 0):
            raise SimulationError("SampledControl.rate_hz", found=repr(self.rate_hz), expected="a rate above 0 Hz")
        if not (is_number(self.delay_s) and self.delay_s >= 0):
            raise SimulationError("SampledControl.delay_s", found=repr(self.delay_s), expected="a time, 0 s or more")
        if self.velocity not in ("difference", "measured"):
            expected = '"difference" or "measured"'
            raise SimulationError("SampledControl.velocity", found=repr(self.velocity), expected=expected)
        bits = self.encoder_bits
        if bits is not None and not (isinstance(bits, int) and not isinstance(bits, bool) and 1 <= bits <= 52):
            expected = "a whole number of bits from 1 to 52, or None"
            raise SimulationError("SampledControl.encoder_bits", found=repr(bits), expected=expected)

    @property
    def encoder_step(self) -> float:
        """One step of an encoder, rad of its rotor; 0 if they are exact."""
        return 0.0 if self.encoder_bits is None else 2 * math.pi / 2**self.encoder_bits


def is_number(value: object) -> bool:
    """Whether something is a finite real number."""
    return isinstance(value, int | float | np.number) and not isinstance(value, bool) and math.isfinite(value)
