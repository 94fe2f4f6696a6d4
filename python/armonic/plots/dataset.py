"""A survey as figures and report read it: what its dims are, their values and labels, and reading it in pieces."""

from __future__ import annotations

import html
import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np

from armonic.errors import SurveyError

if TYPE_CHECKING:
    from collections.abc import Hashable, Iterator, Mapping, Sequence

    import xarray as xr
    from numpy.typing import NDArray

    Array: TypeAlias = NDArray[np.float64]
    Indices: TypeAlias = NDArray[np.intp]

Kind = Literal["path", "sample", "grid", "sweep"]

EVENTS = {1: "crossing", 2: "veering"}
"""Codes of the variable `event`."""
BLOCK = 4_000_000
"""Values that are read at once from a dataset that may be larger than memory."""

LONG = 22
NO_BREAK = "\N{NO-BREAK SPACE}"
STRAIGHT = 0.9
"""Median cosine between steps of a path; even a sample that is ordered by neighbours stays below."""

_PARAMETER_HEADS = ("control", "links", "tool", "frames", "bushings", "joints")


@dataclass(frozen=True)
class Layout:
    """The dims of a survey.

    Attributes:
        kind: along a path, at sampled postures, over a grid of joints, or over a parameter at one posture.
        sweep: the leading dim that is a parameter of the robot file, if any.
        axes: the other dims but "mode": "posture", or the gridded joints.
    """

    kind: Kind
    sweep: str | None
    axes: tuple[str, ...]

    @property
    def dims(self) -> tuple[str, ...]:
        """All dims but "mode"."""
        return self.axes if self.sweep is None else (self.sweep, *self.axes)


def layout_of(ds: xr.Dataset) -> Layout:
    """What the dims of a survey are.

    Raises:
        SurveyError: this is no survey.
    """
    expected = "a dataset from armonic.survey, with natural_freq_hz over a dim 'mode'"
    if not hasattr(ds, "data_vars"):
        raise SurveyError("ds", found=type(ds).__name__, expected=expected)
    frequency = ds.get("natural_freq_hz")
    if frequency is None or "mode" not in frequency.dims or frequency.size == 0:
        found = "no natural_freq_hz" if frequency is None else f"natural_freq_hz over {dict(frequency.sizes)}"
        raise SurveyError("ds", found=found, expected=expected)
    dims = tuple(str(dim) for dim in frequency.dims if dim != "mode")
    if not dims:
        hint = "Keep the dim: ds.isel(posture=[0]) in place of ds.isel(posture=0)."
        raise SurveyError("ds", found="one posture only", expected="a path, a grid, a sample or a sweep", hint=hint)
    sweep = dims[0] if _is_parameter(ds, dims[0]) else None
    axes = dims[1:] if sweep else dims
    if not axes:
        return Layout("sweep", sweep, axes)
    if axes == ("posture",):
        return Layout("sample" if _scattered(ds) else "path", sweep, axes)
    return Layout("grid", sweep, axes)


def specification(ds: xr.Dataset) -> dict[str, Any]:
    """What was surveyed, as the dataset says; empty if it does not."""
    try:
        spec = json.loads(str(ds.attrs.get("spec", "")))
    except ValueError:
        return {}
    return spec if isinstance(spec, dict) else {}


def _is_parameter(ds: xr.Dataset, dim: str) -> bool:
    if dim == "posture":
        return False
    sweep = specification(ds).get("sweep")
    if isinstance(sweep, dict):
        return dim in sweep
    joint = dim.count(".") == 1 and dim.rsplit(".", 1)[1] in ("x", "y", "z", "tx", "ty", "tz", "joint")
    return dim.split(".")[0] in _PARAMETER_HEADS and not joint


def joints(ds: xr.Dataset) -> list[str]:
    """The joint coordinates that the dataset lists per posture, in its order."""
    return [str(name) for name, c in ds.coords.items() if c.dims == ("posture",) and name != "posture"]


def _scattered(ds: xr.Dataset) -> bool:
    """Whether postures are no path: consecutive steps point different ways more often than not."""
    names = joints(ds)
    if not names or ds.sizes["posture"] < 4:
        return False
    steps = np.diff(np.stack([np.asarray(ds[name], float)[:BLOCK] for name in names]), axis=1)
    lengths = np.linalg.norm(steps, axis=0)
    if not lengths.any():  # one posture again and again
        return False
    cosines = np.sum(steps[:, 1:] * steps[:, :-1], axis=0) / np.maximum(lengths[1:] * lengths[:-1], 1e-300)
    return bool(np.median(cosines) < STRAIGHT)


def unit_of(ds: xr.Dataset, name: str) -> str:
    """The unit in which figures show a coordinate; angles are shown in degrees."""
    unit = str(ds[name].attrs.get("units", "")) if name in ds.coords else ""
    return "°" if unit in ("rad", "radian", "radians") else unit.replace(" ", "·") if unit not in ("1", "-") else ""


def shown_values(ds: xr.Dataset, name: str) -> Array:
    """The values of a dim as figures show them: angles in degrees, a dim without values by index."""
    values = np.asarray(ds[name].values, float) if name in ds.coords else np.arange(ds.sizes[name], dtype=float)
    return np.degrees(values) if unit_of(ds, name) == "°" else values


def title_of(ds: xr.Dataset, name: str) -> str:
    """Title of the axis of a dim, escaped: "link_2.z, °"."""
    if name == "posture":
        return "Posture"
    unit = unit_of(ds, name)
    return html.escape(f"{name}, {unit}" if unit else name)


def place_of(ds: xr.Dataset, at: Mapping[str, int]) -> str:
    """Where in the survey, as text that is not escaped: "posture 8, tool.mass = 4 kg"."""
    words = []
    for name in sorted(at, key=lambda dim: _is_parameter(ds, dim)):  # the sweep last
        value, unit = float(shown_values(ds, name)[at[name]]), unit_of(ds, name)
        number = f"{value:.4g}°" if unit == "°" else f"{value:.6g} {unit}".rstrip()
        word = f"posture {value:.0f}" if name == "posture" else f"{name} = {number.replace('-', '−')}"
        # Lines of tables and tiles break between words, and within long ones only.
        first, *rest = word.split(" ")
        space = " " if len(word) > LONG else NO_BREAK
        words.append(space.join([first, NO_BREAK.join(rest)]) if rest else first)
    return ", ".join(words)


def mode_numbers(ds: xr.Dataset, modes: Sequence[int] | None = None) -> list[int]:
    """The modes to draw, by the numbers that the dataset gives them.

    Raises:
        SurveyError: one is not there, or none is asked for.
    """
    present = [int(k) for k in ds["mode"].values] if "mode" in ds.coords else list(range(1, ds.sizes["mode"] + 1))
    if modes is None:
        return present
    missing = [mode for mode in modes if mode not in present]
    if missing or not len(modes):
        expected = f"mode numbers from {present[0]} to {present[-1]}"
        raise SurveyError("modes", found=f"mode {missing[0]}" if missing else "none", expected=expected)
    return [int(mode) for mode in modes]


def mode_positions(ds: xr.Dataset, numbers: Sequence[int]) -> list[int]:
    """Where these modes stand along the dim "mode"."""
    present = mode_numbers(ds)
    return [present.index(number) for number in numbers]


def blocks(ds: xr.Dataset, along: str, *, multiple: int = 1) -> Iterator[tuple[int, xr.Dataset]]:
    """Pieces along a dim small enough to read at once, each with the index it starts at.

    Args:
        ds: a survey.
        along: a dim.
        multiple: lengths of the pieces are multiples of this, the last one aside.
    """
    total = ds.sizes[along]
    each = max(1, ds["natural_freq_hz"].size // total)
    width = multiple * max(1, BLOCK // (each * multiple))
    for start in range(0, total, width):
        yield start, ds.isel({along: slice(start, start + width)})


def ordered(variable: xr.DataArray, dims: Sequence[Hashable]) -> NDArray[Any]:
    """The values with these dims in this order."""
    return np.asarray(variable.transpose(*dims).values)


def evenly(total: int, limit: int) -> Indices:
    """At most `limit` of `total` indices, evenly spaced, both ends included."""
    return np.unique(np.linspace(0, total - 1, min(total, limit)).round().astype(np.intp))
