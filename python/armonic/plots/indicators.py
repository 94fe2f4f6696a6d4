"""Mode-indicator functions over frequency: how many modes a set of responses shows, and where."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from armonic.plots.look import GRID, MUTED, log_axis, mode_colour
from armonic.plots.panes import WIDTH, Sheet
from armonic.plots.series import thinned

if TYPE_CHECKING:
    from collections.abc import Sequence

    import plotly.graph_objects as go
    from numpy.typing import NDArray

    from armonic.frf_set import FrfSet

    Array: TypeAlias = NDArray[np.float64]

MOST_CURVES = 6
"""Singular values, and eigenvalues, that are drawn: those that follow show no mode that these do not."""
MOST_LINES = 2400

_COLOURS = ("#1a1e23", "#5c6670", "#8b949c", "#a9b1b8", "#c3c9cf", "#d9dee3")
"""Greys: colours are those of the modes."""
_LEFT, _TOP, _HEIGHTS, _GAP, _UNDER = 64, 62, (230, 150), 12, 46


def mode_indicators(frfs: FrfSet, freq_hz: Sequence[float] = ()) -> go.Figure:
    """Draw the complex mode indicator function (CMIF) over the multivariate one (MMIF), with modes as lines.

    A peak of a singular value of the FRF matrix is a mode (Shih, Tsuei, Allemang and Brown 1988); of two close together
    each has a peak of its own, one in the first and one in the second. The MMIF dips to zero where some combination of
    the forces makes the structure respond as a single real mode (Williams, Crowley and Vold 1985). Of more forces than
    responses some combination always moves nothing that is watched; then the MMIF is that of the transposed matrix, as
    reciprocity allows.

    Args:
        frfs: the responses; pairs that were not measured count as zero.
        freq_hz: where the modes lie that were found, numbered from 1 in this order.
    """
    from armonic.identification.mode_indicators import complex_mode_indicator, multivariate_mode_indicator

    if frfs.freq_hz[0] == 0 and len(frfs.freq_hz) > 1:  # where accelerance does not determine receptance
        frfs = frfs.lines(np.arange(1, len(frfs.freq_hz)))
    f = frfs.freq_hz
    sheet = Sheet(_TOP + sum(_HEIGHTS) + _GAP + _UNDER, hovermode="x unified")
    values, dips = complex_mode_indicator(frfs), multivariate_mode_indicator(_tall(frfs))
    limits = [float(f[0]), float(f[-1])] if len(f) > 1 else [float(f[0]) - 0.5, float(f[0]) + 0.5]
    width, colours = WIDTH - _LEFT - 12, {"gridcolor": GRID, "tickfont": {"color": MUTED, "size": 11}}
    across = {"range": limits, "nticks": 12, "hoverformat": ".6~g"}
    upper = sheet.pane(
        _LEFT,
        _TOP,
        width,
        _HEIGHTS[0],
        x=across | {"showticklabels": False, "ticks": ""},
        y=log_axis(values[:, :MOST_CURVES]) | {"title": {"text": "CMIF"}},
    )
    lower = sheet.pane(
        _LEFT,
        _TOP + _HEIGHTS[0] + _GAP,
        width,
        _HEIGHTS[1],
        x=across | {"matches": upper.x, "title": {"text": "Frequency (Hz)"}},
        y=colours | {"range": [-0.03, 1.03], "title": {"text": "MMIF"}},
    )
    # The last is drawn first: the curve that counts lies on top.
    for pane, curves, digits in ((upper, values, ".3e"), (lower, dips, ".4f")):
        for k in reversed(range(min(curves.shape[1], MOST_CURVES))):
            curve = curves[:, k]
            kept = thinned(np.log(np.where(curve > 0, curve, np.nan)), limit=MOST_LINES)
            pane.scatter(
                x=f[kept].astype(np.float32),
                y=curve[kept].astype(np.float32),
                mode="lines" if len(kept) > 1 else "markers",
                line={"color": _COLOURS[k], "width": 1.6 if k == 0 else 1.1},
                name=_ordinal(k),
                legendgroup=str(k),
                legendrank=k + 1,
                showlegend=pane is upper,
                hovertemplate=f"%{{y:{digits}}}",
            )
    for number, at in enumerate(freq_hz, 1):
        if limits[0] <= at <= limits[1]:
            upper.upright(float(at), str(number), color=mode_colour(number), width=1.1)
            lower.upright(float(at), color=mode_colour(number), width=1.1)
    return sheet.figure


def _tall(frfs: FrfSet) -> FrfSet:
    """The responses with no more forces than places: transposed if need be."""
    if len(frfs.inputs) <= len(frfs.outputs):
        return frfs
    return replace(
        frfs,
        values=frfs.values.swapaxes(1, 2),
        outputs=frfs.inputs,
        inputs=frfs.outputs,
        measured=frfs.measured.T,
        coherence=None,
        averages=None,
    )


def _ordinal(k: int) -> str:
    return ("first", "second", "third", "fourth", "fifth", "sixth")[k]
