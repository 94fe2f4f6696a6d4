"""What every report shares: one HTML page that holds all it shows, opens offline and takes no name for markup."""

from __future__ import annotations

import platform
from datetime import datetime
from importlib import resources
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy
from jinja2 import Environment, FunctionLoader, StrictUndefined
from markupsafe import Markup
from plotly.offline import get_plotlyjs

import armonic
from armonic.plots.look import FONT_STACK, VERDICT_COLOURS

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    import plotly.graph_objects as go

WIDTH = 1080
"""Of the page and its figures, in pixels: the same on a screen and on paper."""

DO_VU_LIU = (
    "T.-T. Do, V.-H. Vu, Z. Liu: Linearization of dynamic equations for vibration and modal analysis of"
    " flexible joint manipulators. Mechanism and Machine Theory, 2022."
)
ALLEMANG_BROWN = (
    "R. J. Allemang, D. L. Brown: A correlation coefficient for modal vector analysis. Proceedings of the"
    " 1st International Modal Analysis Conference, 1982."
)

_CONFIG = {"displaylogo": False, "toImageButtonOptions": {"format": "svg"}}
_BUTTONS = {"scatter3d": ["toImage", "resetCameraDefault3d"], "scatterpolar": ["toImage"]}


def render_page(template: str, content: Mapping[str, Any], *, libraries: Mapping[str, str] | None = None) -> str:
    """Fill a template that extends page.html.j2.

    Args:
        template: its file name, beside this module.
        content: what it names, besides what the page itself needs; text is escaped.
        libraries: versions by name of what was used besides Python, NumPy and SciPy.

    Returns:
        The text of the page.
    """
    # Names come from the user's files: everything is escaped but what embedder made.
    environment = Environment(
        loader=FunctionLoader(_source), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    versions = {
        "Armonic": armonic.__version__,
        "Python": platform.python_version(),
        "NumPy": np.__version__,
        "SciPy": scipy.__version__,
    } | dict(libraries or {})
    return environment.get_template(template).render(
        **content,
        made=datetime.now().astimezone(),
        versions=", ".join(f"{name} {version}" for name, version in versions.items()),
        colours=VERDICT_COLOURS,
        fonts=Markup(FONT_STACK),
        plotly_js=Markup(get_plotlyjs()),
    )


def _source(template: str) -> str:
    return resources.files("armonic").joinpath(template).read_text("utf-8")


def embedder() -> Callable[[go.Figure], Markup]:
    """A function from a figure to its HTML, with ids counted up, so that two reports of one result are alike."""
    number = 0

    def embed(figure: go.Figure) -> Markup:
        nonlocal number
        number += 1
        if figure.layout.width is None:
            figure.update_layout(width=WIDTH)
        kind = figure.data[0].type if figure.data else ""
        config = _CONFIG | {"modeBarButtons": [_BUTTONS.get(kind, ["toImage", "resetScale2d"])]}
        return Markup(figure.to_html(full_html=False, include_plotlyjs=False, div_id=f"figure-{number}", config=config))

    return embed
