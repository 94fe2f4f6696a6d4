"""HTML pages as a reader and a browser get them."""

from __future__ import annotations

import base64
import json
import re
from html.parser import HTMLParser
from typing import Any

import numpy as np
from numpy.typing import NDArray

HOSTILE = "<script>alert(1)</script><img src=http://x.test/a.png onerror=alert(2)> & \"'{{ 7*7 }}"


class Page(HTMLParser):
    """Every tag with its attributes, the text, and the rows of tables."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.rows: list[list[str]] = []
        self.scripts: list[str] = []
        self.text = ""
        self.inside: list[str] = []
        self.feed(html)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        self.inside.append(tag)
        if tag == "tr":
            self.rows.append([])
        if tag == "td":
            self.rows[-1].append("")
        if tag == "script":
            self.scripts.append("")

    def handle_endtag(self, tag: str) -> None:
        while self.inside and self.inside.pop() != tag:
            pass

    def handle_data(self, data: str) -> None:
        if "script" in self.inside:
            self.scripts[-1] += data
        elif "style" not in self.inside:
            self.text += data
            if "td" in self.inside:
                self.rows[-1][-1] += data.strip()


def figures(page: Page) -> list[list[dict[str, Any]]]:
    """The traces of every figure, as the browser gets them."""
    found = []
    for script in page.scripts[1:]:
        for call in re.finditer(r'Plotly\.newPlot\(\s*"figure-\d+",\s*', script):
            found.append(json.JSONDecoder().raw_decode(script, call.end())[0])
    return found


def numbers(data: Any) -> NDArray[np.float64]:
    if isinstance(data, dict):
        flat = np.frombuffer(base64.b64decode(data["bdata"]), np.dtype(data["dtype"]))
        return flat.astype(float)
    return np.array([np.nan if value is None else value for value in data], float)


def outside(html: str) -> list[str]:
    """What a page would load from elsewhere or lets others do; empty for one that stands alone."""
    page = Page(html)
    found = [f"{tag} loads" for tag, attributes in page.tags if {"src", "href", "srcset", "data"} & set(attributes)]
    found += [tag for tag, _ in page.tags if tag in {"link", "iframe", "object", "embed", "base", "img"}]
    style = html[html.index("<style>") : html.index("</style>")]
    found += [word for word in ("url(", "@import") if word in style]
    policies = [str(a["content"]) for tag, a in page.tags if tag == "meta" and "http-equiv" in a]
    if len(policies) != 1 or "default-src 'none'" not in policies[0] or "http" in policies[0]:
        found.append(f"policy {policies}")
    return found
