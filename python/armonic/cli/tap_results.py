"""A virtual tap test, shown: every hit as it was given, and the true modes that the records should tell."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from armonic.cli.results import modes_data
from armonic.cli.terminal import heading, table
from armonic.text import count, format_duration, format_hz, format_si

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.table import Table

    from armonic.simulation.hammer import Blow
    from armonic.simulation.tap_test import TapTest

IN_BAND = 0.4
"""Of the sampling rate: what lies above, an anti-alias filter hides."""


def tap_tables(test: TapTest) -> Iterator[RenderableType]:
    """What is printed of a test."""
    record = test.records[0]
    yield heading(f"{test.robot.name}, posture {test.posture}")
    hits = sum(map(len, test.blows))
    yield (
        f"{count(hits, 'hit')} on {', '.join(test.points)}, watched at {', '.join(test.sensors)};"
        f" {count(len(test.records), 'record')} of {format_si(len(record) / record.sample_rate_hz, 's')} at"
        f" {record.sample_rate_hz:g} Hz, in {format_duration(test.seconds)}."
    )
    yield ""
    yield _hit_table(test)
    yield ""
    most = format_si(test.acceleration_range, digits=3)
    yield f"Ranges: force ± {format_si(test.force_range_n, 'N', digits=3)}, acceleration ± {most} m/s²."
    yield ""
    highest = IN_BAND * record.sample_rate_hz
    yield heading(f"True modes of small motions below {highest:g} Hz")
    yield _mode_table(test, highest)


def _hit_table(test: TapTest) -> Table:
    grid = table(">record", "point", ">at s", ">peak N", ">contact ms", "")
    for number, blows in enumerate(test.blows, 1):
        for blow in blows:
            numbers = format_si(blow.start_s), format_si(blow.peak_n), format_si(1e3 * blow.pulse_s, digits=3)
            grid.add_row(str(number), blow.point, *numbers, _remark(blow))
    return grid


def _remark(blow: Blow) -> str:
    words = []
    if blow.sort == "double":
        words.append(f"double hit: {format_si(blow.rebound_n, 'N', digits=3)} at {format_si(blow.rebound_s, 's')}")
    if blow.overloaded:
        words.append("overload")
    return ", ".join(words)


def _mode_table(test: TapTest, highest: float) -> Table:
    grid = table(">", ">natural Hz", ">damped Hz", ">damping %")
    modes = test.modes
    for k, i in enumerate(np.flatnonzero(modes.oscillatory & (modes.natural_freq_hz < highest)), 1):
        natural, damped = format_hz(float(modes.natural_freq_hz[i])), format_hz(float(modes.damped_freq_hz[i]))
        grid.add_row(str(k), natural, damped, f"{100 * modes.damping_ratio[i]:.2f}")
    return grid


def tap_data(test: TapTest) -> dict[str, Any]:
    """The same for machines."""
    record = test.records[0]
    return {
        "robot": test.robot.name,
        "posture": test.posture,
        "status": test.status,
        "points": list(test.points),
        "sensors": list(test.sensors),
        "records": len(test.records),
        "samples": len(record),
        "sample_rate_hz": record.sample_rate_hz,
        "force_range_n": test.force_range_n,
        "acceleration_range": test.acceleration_range,
        "hits": [
            {
                "record": number,
                "point": blow.point,
                "sort": blow.sort,
                "start_s": blow.start_s,
                "peak_n": blow.peak_n,
                "pulse_s": blow.pulse_s,
                "direction": list(blow.direction),
                "offset_m": list(blow.offset_m),
                "rebound_s": blow.rebound_s if blow.sort == "double" else None,
                "rebound_n": blow.rebound_n if blow.sort == "double" else None,
                "overloaded": blow.overloaded,
            }
            for number, blows in enumerate(test.blows, 1)
            for blow in blows
        ],
        "modes": modes_data(test.modes),
        "seconds": test.seconds,
    }
