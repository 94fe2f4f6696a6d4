"""A figure of many panes: rectangles placed in pixels, each with axes of its own."""

from __future__ import annotations

from typing import Any

import plotly.graph_objects as go

from armonic.plots.look import INK, MUTED, TEMPLATE

WIDTH = 1080
"""Of a figure, in pixels, as wide as the page of a report."""


class Sheet:
    """A figure of fixed size, on which panes are placed in pixels from its top left corner.

    Args:
        height: in pixels.
        width: in pixels.
        hovermode: what a pointer shows, as plotly names it.
    """

    def __init__(self, height: int, *, width: int = WIDTH, hovermode: str = "closest") -> None:
        self.width, self.height, self._panes = width, height, 0
        self.figure = go.Figure(layout={"template": TEMPLATE, "width": width, "height": height, "hovermode": hovermode})
        self.figure.update_layout(margin={"l": 0, "r": 0, "t": 0, "b": 0}, legend={"traceorder": "normal"})

    def pane(
        self, left: float, top: float, width: float, height: float, *, x: dict[str, Any], y: dict[str, Any]
    ) -> Pane:
        """A new pane.

        Args:
            left: in pixels, as the next three.
            top: of the pane.
            width: of the pane.
            height: of the pane.
            x: what its axis along x has beside the look of all.
            y: the same along y.
        """
        self._panes += 1
        number = str(self._panes) if self._panes > 1 else ""
        across = [left / self.width, min((left + width) / self.width, 1.0)]
        up = [max(1 - (top + height) / self.height, 0.0), 1 - top / self.height]
        self.figure.layout[f"xaxis{number}"] = x | {"domain": across, "anchor": f"y{number}"}
        self.figure.layout[f"yaxis{number}"] = y | {"domain": up, "anchor": f"x{number}"}
        return Pane(self, number)

    def write(self, left: float, top: float, text: str, **more: Any) -> None:
        """A line of text whose lower left corner lies here, in pixels."""
        place = {"x": left / self.width, "y": 1 - top / self.height, "xref": "paper", "yref": "paper"}
        look = {"xanchor": "left", "yanchor": "bottom", "showarrow": False, "font": {"size": 11, "color": MUTED}}
        self.figure.add_annotation(text=text, **(place | look | more))


class Pane:
    """A rectangle of a sheet; what is drawn into it stands in its axes.

    Attributes:
        x: name of its axis along x, for others that should follow it.
        y: the same along y.
    """

    def __init__(self, sheet: Sheet, number: str) -> None:
        self.sheet, self.x, self.y = sheet, f"x{number}", f"y{number}"

    def scatter(self, **trace: Any) -> None:
        """A curve or dots."""
        self.sheet.figure.add_scatter(xaxis=self.x, yaxis=self.y, **trace)

    def upright(self, at: float, name: str = "", **line: Any) -> None:
        """A vertical line over the whole pane, with its name at the top."""
        shape = {"type": "line", "x0": at, "x1": at, "y0": 0, "y1": 1, "layer": "below"}
        ends = {"xref": self.x, "yref": f"{self.y} domain"}
        self.sheet.figure.add_shape(**shape, **ends, line={"color": INK, "width": 1} | line)
        if name:
            look = {"showarrow": False, "xanchor": "center", "yanchor": "bottom"}
            font = {"size": 10.5, "color": line.get("color", INK)}
            self.sheet.figure.add_annotation(text=name, x=at, y=1, font=font, **look, **ends)
