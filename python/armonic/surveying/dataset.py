"""The labelled result of a survey: which variables it has, over which axes, in which units."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

import armonic

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import NDArray

    from armonic.surveying.block import Block
    from armonic.surveying.systems import Field

    Values: TypeAlias = NDArray[Any]

FORMAT = 1
"""Version of the layout of stored maps."""


class Variable(NamedTuple):
    """One variable of the result: dtype, what follows the survey's axes, and how it is described."""

    name: str
    dtype: str
    tail: tuple[str, ...]
    units: str
    long_name: str


VARIABLES = (
    Variable("pole", "c16", ("mode",), "rad/s", "pole; of two real poles the one further right"),
    Variable("partner", "c16", ("mode",), "rad/s", "other pole of the mode: the conjugate, or the second real one"),
    Variable("natural_freq_hz", "f8", ("mode",), "Hz", "natural frequency"),
    Variable("damped_freq_hz", "f8", ("mode",), "Hz", "damped natural frequency"),
    Variable("damping_ratio", "f8", ("mode",), "1", "damping ratio"),
    Variable("mac", "f4", ("mode",), "1", "modal assurance criterion with the shape at the posture before"),
    Variable("event", "i1", ("mode",), "1", "0 none, 1 crossing, 2 veering"),
    Variable("shape", "c16", ("mode", "coordinate"), "rad or m", "mode shape, u^H M u = 1"),
    Variable("participation", "f4", ("mode", "spring"), "1", "share of the elastic energy"),
    Variable("stability", "i1", (), "1", "1 asymptotically stable, 0 marginal, -1 unstable"),
    Variable("method", "i1", (), "1", "0 continuation, 1 dense solver"),
    Variable("residual", "f4", (), "1", "largest residual as a share of what is tolerated"),
)


@dataclass(frozen=True)
class Layout:
    """Axes, coordinates and attributes of one survey's result.

    Attributes:
        field: the robot and the walk.
        modes: number of modes m.
        shapes: whether shapes are kept.
        participation: whether energy shares are kept.
    """

    field: Field
    modes: int
    shapes: bool
    participation: bool

    def variables(self) -> Iterator[tuple[Variable, tuple[str, ...], tuple[int, ...]]]:
        """Every variable with its dimensions and shape."""
        walk = self.field.walk
        sizes = {"mode": self.modes, "coordinate": len(self._names), "spring": len(self._springs)}
        kept = {"shape": self.shapes, "participation": self.participation}
        for variable in VARIABLES:
            if kept.get(variable.name, True):
                yield (
                    variable,
                    (*walk.axes, *variable.tail),
                    (*walk.shape, *(sizes[name] for name in variable.tail)),
                )

    def values(self, block: Block) -> dict[str, Values]:
        """The variables of a block, (P, ...) each, in the order of the walk."""
        poles = np.ascontiguousarray(block.poles[:, :, 0])
        size = np.abs(poles)
        values: dict[str, Any] = {
            "pole": poles,
            "partner": block.poles[:, :, 1],
            "natural_freq_hz": size / (2 * np.pi),
            "damped_freq_hz": poles.imag / (2 * np.pi),
            "damping_ratio": np.divide(-poles.real, size, out=np.zeros(size.shape), where=size > 0),
            "mac": block.mac,
            "event": block.event,
            "shape": block.shapes,
            "participation": block.participation,
            "stability": block.stability,
            "method": block.method,
            "residual": block.residual,
        }
        return {v.name: values[v.name].astype(v.dtype, copy=False) for v, _, _ in self.variables()}

    @property
    def _springs(self) -> list[str]:
        return [self.field.robot.coordinates[i] for i in self.field.keep]

    @property
    def _names(self) -> list[str]:
        return [*self._springs, *self.field.robot.motors]

    def coords(self) -> dict[str, tuple[tuple[str, ...], Values, dict[str, Any]]]:
        """Coordinate variables by name: dimensions, values, attributes."""
        walk, robot = self.field.walk, self.field.robot
        out: dict[str, tuple[tuple[str, ...], Values, dict[str, Any]]] = {
            "mode": (("mode",), np.arange(1, self.modes + 1), {"long_name": "mode, by natural frequency at the start"})
        }
        for path, values in walk.sweep.items():
            out[path] = ((walk.axes[0],), values, {"units": robot.unit(path)})
        for name, values in walk.coordinates.items():
            out[name] = ((name,), values, {"units": self._unit(name)})
        if walk.listed is not None:
            axis = walk.axes[-1]
            out[axis] = ((axis,), np.arange(walk.shape[-1]), {"long_name": "posture along the walk"})
            for i, name in enumerate(robot.coordinates):
                if name in robot.joint_coordinates or walk.listed[:, i].any():
                    out[name] = ((axis,), walk.listed[:, i], {"units": self._unit(name)})
        if self.shapes:
            out["coordinate"] = (("coordinate",), np.array(self._names), {})
        if self.participation:
            out["spring"] = (("spring",), np.array(self._springs), {})
        return out

    def _unit(self, name: str) -> str:
        kinds = [kind for kind in self.field.robot.tree.kinds if kind != "fixed"]
        return "rad" if kinds[self.field.robot.coordinates.index(name)] == "revolute" else "m"

    def attributes(self) -> dict[str, Any]:
        """What the result says of its origin."""
        field, robot = self.field, self.field.robot
        given = field.load
        load = None
        if given.frame is not None:
            load = {"frame": robot.frames[given.frame], "wrench": given.wrench.tolist(), "axes": given.axes}
        spec = {"format": FORMAT, **field.walk.described(), "load": load, "modes": self.modes}
        spec |= {"shapes": self.shapes, "participation": self.participation}
        if robot.urdf is not None:  # the robot file alone does not say all
            spec["urdf_sha256"] = hashlib.sha256(robot.urdf.content).hexdigest()
        return {
            "title": f"Modal map of {robot.name}",
            "robot": robot.name,
            "robot_file": robot.to_yaml(),
            "armonic": armonic.__version__,
            "spec": json.dumps(spec, sort_keys=True),
            "source": "Do, Vu, Liu 2022 (modal parameters in the workspace), computed by Armonic",
        }

    def empty(self) -> dict[str, Values]:
        """Arrays for all variables in memory."""
        return {v.name: np.empty(shape, v.dtype) for v, _, shape in self.variables()}

    def dataset(self, values: dict[str, Values]) -> xr.Dataset:
        """The result from its variables in memory."""
        import xarray as xr

        data = {
            v.name: (dims, values[v.name], {"units": v.units, "long_name": v.long_name})
            for v, dims, _ in self.variables()
        }
        return xr.Dataset(data, coords=self.coords(), attrs=self.attributes())
