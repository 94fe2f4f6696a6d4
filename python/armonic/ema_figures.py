"""Figures of the report of an experimental modal analysis, and how its modes pair with those of a model."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from markupsafe import Markup

from armonic.comparison import compare
from armonic.comparison_at import modes_at
from armonic.frf_set import split_label
from armonic.identification_tables import frequency_labels
from armonic.linear import model_of
from armonic.modal import mac
from armonic.page import WIDTH
from armonic.plots.matrices import mac_matrix
from armonic.plots.motion import shape_animation, shape_stills
from armonic.response import KINDS
from armonic.synthesis import AXES

if TYPE_CHECKING:
    from collections.abc import Callable

    import plotly.graph_objects as go

    from armonic.comparison import Comparison
    from armonic.files.measured_file import Geometry
    from armonic.frf_set import FrfSet
    from armonic.identification.ema import EmaResult
    from armonic.linear import Posture
    from armonic.modal import Modes
    from armonic.robot import Robot

    Embed = Callable[[go.Figure], Markup]


@dataclass(frozen=True)
class Place:
    """Where measured points are: on a robot in a posture, or by a geometry."""

    robot: Robot | None
    posture: Posture | None
    geometry: Geometry | None

    def known(self, label: str) -> bool:
        """Whether a degree of freedom has a position and moves a point."""
        place, axis = split_label(label)
        named = self.geometry.names if self.geometry is not None else ()
        return axis in ("x", "y", "z") and (self.framed(label) or place in named)

    def framed(self, label: str) -> bool:
        """Whether a degree of freedom is one of a frame of the robot."""
        frame, axis = split_label(label)
        return self.robot is not None and frame in self.robot.frames and axis in AXES


def compared(result: EmaResult, reference: Modes, place: Place) -> Comparison:
    """Pairs with the model, by shapes too where the robot says how its frames move."""
    labels = [label for label in result.channels if place.framed(label)]
    if place.robot is None or not labels:
        return compare(result, reference)
    model = model_of(place.robot, place.posture, wrench=None, frame=None, equilibrium="reference")
    return compare(result, modes_at(model, reference, labels))


def within(reference: Modes | None, frfs: FrfSet) -> Any:
    """The modes of the model that lie in the band: others would stretch the diagram."""
    if reference is None:
        return None
    f = reference.natural_freq_hz
    inside = (f >= frfs.freq_hz[0]) & (f <= frfs.freq_hz[-1])
    return replace(reference, oscillatory=reference.oscillatory & inside)


def synthesized(result: EmaResult) -> dict[str, FrfSet]:
    """The modal model over the measurement: with the exponential window that this has, and without."""
    frfs, curves = result.frfs, {}
    if not result.modes:
        return {}
    if frfs.decay_rate:
        model = result.model
        values = model.receptance(frfs.s) * (frfs.s ** KINDS.index(frfs.kind))[:, None, None]
        curves["synthesized, same window"] = replace(frfs, values=values, coherence=None, measured=model.measured)
    lines = frfs.freq_hz[frfs.freq_hz > 0]  # a lower residual has no value at 0 Hz
    return curves | {"synthesized": result.synthesized(lines)}


def stills(
    result: EmaResult, reference: Modes | None, comparison: Comparison | None, place: Place, embed: Embed
) -> list[tuple[str, Markup]]:
    """Shapes at rest and at both extremes."""
    return [
        (caption, embed(shape_stills(place.robot, place.posture, shapes, select=select, geometry=place.geometry)))
        for caption, shapes, select in _drawn(result, reference, comparison, place)
    ]


def motions(
    result: EmaResult, reference: Modes | None, comparison: Comparison | None, place: Place
) -> list[tuple[str, Markup]]:
    """Animations; none plays until its button is pressed."""
    found = []
    for number, (caption, shapes, select) in enumerate(_drawn(result, reference, comparison, place), 1):
        figure = shape_animation(place.robot, place.posture, shapes, select=select, geometry=place.geometry)
        figure.update_layout(width=WIDTH)
        config = {"displaylogo": False, "modeBarButtons": [["toImage", "resetCameraDefault3d"]]}
        page = figure.to_html(
            full_html=False, include_plotlyjs=False, auto_play=False, div_id=f"figure-{900 + number}", config=config
        )
        found.append((caption, Markup(page)))
    return found


def _drawn(
    result: EmaResult, reference: Modes | None, comparison: Comparison | None, place: Place
) -> list[tuple[str, Any, list[int] | None]]:
    """What shapes are drawn, and which of them: those identified, and their partners in the model."""
    found: list[tuple[str, Any, list[int] | None]] = []
    if any(place.known(label) for label in result.channels):
        found.append(("Identified: measured points", result, None))
    if comparison is not None and comparison.pairs and place.robot is not None and reference is not None:
        select = [pair.index_b + 1 for pair in comparison.pairs if reference.oscillatory[pair.index_b]]
        if select:
            found.append(("The model: the whole robot, in the modes paired with them", reference, select))
    return found


def macs(
    result: EmaResult, reference: Modes | None, comparison: Comparison | None, embed: Embed
) -> list[tuple[str, Markup]]:
    """AutoMAC of the identified modes, and MAC with the model where both have shapes at the same places."""
    own, found = frequency_labels(result.natural_freq_hz), []
    shapes = np.stack([np.asarray(mode.shape, np.complex128) for mode in result.modes], axis=1)
    shapes = shapes[np.isfinite(shapes).all(axis=1)]
    if len(shapes) > 1 and (np.abs(shapes).max(axis=0) > 0).all():
        figure = mac_matrix(mac(shapes, shapes), own, own, row_title="identified", column_title="identified")
        found.append(("AutoMAC of the identified modes", embed(figure)))
    if comparison is not None and reference is not None and comparison.mac is not None:
        f = reference.natural_freq_hz
        shown = np.isfinite(comparison.mac).any(axis=0) & (f <= 1.2 * result.frfs.freq_hz[-1])
        columns, rows = np.flatnonzero(shown), np.flatnonzero(np.isfinite(comparison.mac).any(axis=1))
        if rows.size and columns.size:
            names = [own[k] for k in rows], frequency_labels(f[columns])
            cross = comparison.mac[np.ix_(rows, columns)]
            figure = mac_matrix(cross, *names, row_title="identified", column_title="model")
            found.append((f"MAC with the model, over {', '.join(comparison.coordinates)}", embed(figure)))
    return found
