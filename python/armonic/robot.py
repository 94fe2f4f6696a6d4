"""The robot: loaded from a file, asked for postures and parameters, changed into a new robot, and saved."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from armonic import catalog
from armonic.description.document import Document, is_file, read_text
from armonic.description.drives import Array, Control, Drives
from armonic.description.from_urdf import UrdfDocument, from_urdf, is_urdf, with_urdf
from armonic.description.names import did_you_mean, listed
from armonic.description.numbers import Number, list_numbers, select, unknown_path
from armonic.description.reading import read_description
from armonic.description.schema import RobotDescription
from armonic.description.tree import Bushing, Tree, compile_tree
from armonic.description.units import number, shown, si_unit
from armonic.description.values import write
from armonic.errors import PostureError, RobotFileError
from armonic.writing import write_whole

if TYPE_CHECKING:
    from armonic._core import Mechanism
    from armonic.description.urdf import Urdf

PostureLike = str | Sequence[float | str] | Mapping[str, float | str] | Array
"""A name in the file, the joint coordinates, all coordinates, or values by coordinate name."""


def load(source: str | Path) -> Robot:
    """Load a robot.

    Args:
        source: the path of a robot file or a URDF, or a name from the catalog ("kuka_kr90"). A file of that name
            wins.

    Returns:
        The robot.

    Raises:
        RobotFileError: there is no such file or name, or the file is not a valid robot description.
    """
    path, name = Path(source), str(source)
    if is_file(path):
        if is_urdf(path):
            return Robot._from_document(from_urdf(path), path)
        return Robot.from_yaml(read_text(path), path=path)
    names = catalog.names()
    if name in names:
        return Robot.from_yaml(catalog.read(name), origin=f"{name}.yaml")
    raise RobotFileError(
        name or "robot",
        found="a directory" if name and os.path.isdir(name) else "no file there",  # noqa: PTH112
        expected=f"a robot file, or a name from the catalog: {listed(names)}",
        hint=did_you_mean(name, names),
    )


@dataclass(frozen=True, eq=False, repr=False)
class Robot:
    """A robot, checked and compiled; it never changes. All values are in SI and radians.

    Coordinates are named "link.key". They stand in tree order, for each joint its own coordinate first, then
    the virtual ones about x, y, z and along tx, ty, tz. Make one with `load` or `Robot.from_yaml`.
    """

    _document: Document
    _description: RobotDescription
    _tree: Tree
    _path: Path | None = None

    @classmethod
    def from_yaml(cls, text: str, *, path: Path | None = None, origin: str = "robot file") -> Robot:
        """Make a robot from the text of a robot file.

        Args:
            text: YAML.
            path: the file it came from, if any; `urdf` is relative to its folder, or else to the working folder.
            origin: what error messages call the text if it has no path.

        Raises:
            RobotFileError: the text is not a valid robot description.
        """
        document = Document(text, origin if path is None else str(path))
        return cls._from_document(with_urdf(document, Path() if path is None else path.parent), path)

    @classmethod
    def _from_document(cls, document: Document, path: Path | None) -> Robot:
        description = read_description(document)
        return cls(document, description, compile_tree(description), path)

    def __reduce__(self) -> tuple[object, ...]:
        # The texts say all; the compiled mechanism cannot be pickled.
        return _restore, (self.to_yaml(), self._path, self._document.origin, self.urdf)

    def __repr__(self) -> str:
        return f"<Robot {self.name!r}: {', '.join(self.coordinates)}>"

    @property
    def name(self) -> str:
        """The robot's name."""
        return self._description.name

    @property
    def source(self) -> str | None:
        """Where its numbers come from."""
        return self._description.source

    @property
    def path(self) -> Path | None:
        """The file it was loaded from; None for the catalog and for changed robots."""
        return self._path

    @property
    def urdf(self) -> Urdf | None:
        """The URDF that its file starts from, as it was when it was read."""
        return self._document.urdf if isinstance(self._document, UrdfDocument) else None

    @property
    def description(self) -> RobotDescription:
        """The checked content of the file."""
        return self._description

    @property
    def tree(self) -> Tree:
        """The robot as arrays."""
        return self._tree

    @cached_property
    def gravity(self) -> Array:
        """(3,) m/s², in the base frame."""
        gravity = np.array(self._description.gravity)
        gravity.setflags(write=False)
        return gravity

    @property
    def coordinates(self) -> tuple[str, ...]:
        """The names of all n coordinates."""
        return self._tree.coordinates

    @property
    def joint_coordinates(self) -> tuple[str, ...]:
        """The names of the joints' own coordinates: what a posture gives."""
        return self._tree.joint_coordinates

    @property
    def flexible(self) -> NDArray[np.bool_]:
        """(n,) whether a coordinate has elasticity or a drive, or is free; linear models lock the others."""
        return self._tree.flexible

    @property
    def stiffness(self) -> Array:
        """(n,) N m/rad or N/m, of the elasticity; 0 where locked, free or driven."""
        return self._tree.stiffness

    @property
    def damping(self) -> Array:
        """(n,) N m s/rad or N s/m, of the elasticity; 0 where locked, free or driven."""
        return self._tree.damping

    @property
    def frames(self) -> tuple[str, ...]:
        """The names of all frames: base, one per link (moving with its joint), those of the file."""
        return self._tree.frames

    @property
    def postures(self) -> Mapping[str, Array]:
        """The postures of the file by name, (n,) each."""
        return MappingProxyType(self._tree.postures)

    @property
    def paths(self) -> Mapping[str, Array]:
        """The paths of the file by name, (P, n) postures each."""
        return self._tree.paths

    @property
    def motors(self) -> tuple[str, ...]:
        """The names of the motors, "link.motor", in the order of the links."""
        return self._tree.drives.names

    @property
    def drives(self) -> Drives:
        """The motors, gears and shafts as arrays, one row per motor."""
        return self._tree.drives

    @property
    def control(self) -> Control:
        """The gains of the motors; all zero where the file has no control."""
        return self._tree.control

    @property
    def bushings(self) -> tuple[Bushing, ...]:
        """The 6x6 springs between frames."""
        return self._tree.bushings

    @cached_property
    def mechanism(self) -> Mechanism:
        """The compiled rigid-body tree, made at first use."""
        from armonic._core import Mechanism

        tree = self._tree
        return Mechanism(
            parents=list(tree.parents),
            placements=tree.placements,
            kinds=list(tree.kinds),
            axes=tree.axes,
            masses=tree.masses,
            coms=tree.coms,
            inertias=tree.inertias,
            frame_nodes=list(tree.frame_nodes),
            frame_placements=tree.frame_placements,
            gravity=self._description.gravity,
        )

    def posture(self, posture: PostureLike) -> Array:
        """The coordinates of a posture.

        Args:
            posture: a name in the file; a sequence of the joint coordinates or of all coordinates; or a
                mapping from coordinate names to values, where those left out are zero. Values are in rad
                and m, or texts with a unit ("70 deg").

        Returns:
            (n,) a new array.

        Raises:
            PostureError: the name or a coordinate is unknown, the length is wrong, or a value is not finite.
        """
        if isinstance(posture, str):
            if posture not in self.postures:
                raise _unknown("posture", posture, "the name of a posture", self.postures)
            return self.postures[posture].copy()
        q = np.zeros(len(self.coordinates))
        if isinstance(posture, Mapping):
            for name, given in posture.items():
                if name not in self.coordinates:
                    raise _unknown("posture", name, "the name of a coordinate", self.coordinates)
                i = self.coordinates.index(name)
                q[i] = self._coordinate(i, given)
            return q
        values = _listed_values(posture)
        if values is not None and len(values) == len(self.joint_coordinates):
            indices: Iterable[int] = self._tree.joint_indices
        elif values is not None and len(values) == len(q):
            indices = range(len(q))
        else:
            expected = f"a name, or {len(self.joint_coordinates)} values: {listed(self.joint_coordinates)}"
            if len(q) != len(self.joint_coordinates):
                expected += f"; or one for each of all {len(q)} coordinates"
            found = shown(posture) if values is None else f"{len(values)} values"
            raise PostureError("posture", found=found, expected=expected)
        for i, value in zip(indices, values, strict=True):
            q[i] = self._coordinate(i, value)
        return q

    def _coordinate(self, i: int, value: object) -> float:
        kinds = [kind for kind in self._tree.kinds if kind != "fixed"]
        if isinstance(value, np.generic):
            value = value.item()
        try:
            return number(value, "angle" if kinds[i] == "revolute" else "length")
        except RobotFileError as error:
            where = f"posture, {self.coordinates[i]}"
            raise PostureError(where, found=error.found, expected=error.expected, hint=error.hint) from None

    def frame_index(self, name: str) -> int:
        """The index of a frame in `frames`.

        Raises:
            PostureError: there is no such frame.
        """
        if name not in self.frames:
            raise _unknown("frame", name, "the name of a frame or link", self.frames)
        return self.frames.index(name)

    @cached_property
    def _numbers(self) -> dict[str, Number]:
        numbers = list_numbers(self._description, self._document.data)
        return {path: number for path, number in numbers.items() if self._document.holds(number.at)}

    def parameters(self, pattern: str | Iterable[str] = "elasticity") -> dict[str, float]:
        """What a fit may change: stiffness and damping of elasticity and bushings by path, in the order of the file.

        Args:
            pattern: a path or shell pattern ("links.arm.elasticity.*.stiffness"), a group ("elasticity",
                "stiffness", "damping"), or several, in a list or separated by commas.

        Returns:
            The values in SI.

        Raises:
            UpdateError: a pattern matches nothing.
        """
        return {path: self._numbers[path].value for path in select(self._numbers, pattern, fits=True)}

    def numbers(self, pattern: str | Iterable[str] = "*") -> dict[str, float]:
        """The numbers of the file by path, also those it leaves at their default.

        Args:
            pattern: a path or shell pattern ("links.*.mass", "control.*"), a group of `parameters`, or several,
                in a list or separated by commas.

        Returns:
            The values in SI.

        Raises:
            UpdateError: a pattern matches nothing.
        """
        return {path: self._numbers[path].value for path in select(self._numbers, pattern, fits=False)}

    def bounds(self, path: str) -> tuple[float, float] | None:
        """The bounds that the file gives a number for a fit, in SI; None if it gives none.

        Raises:
            UpdateError: there is no such number.
        """
        return self._number(path).bounds

    def unit(self, path: str) -> str:
        """The SI unit of a number, "N m/rad" for example; empty for a pure number.

        Raises:
            UpdateError: there is no such number.
        """
        dimension = self._number(path).dimension
        return "" if dimension is None else si_unit(dimension)

    def _number(self, path: str) -> Number:
        if path not in self._numbers:
            raise unknown_path(path, self._numbers)
        return self._numbers[path]

    def with_values(self, values: Mapping[str, float | str]) -> Robot:
        """A new robot with other numbers; the text of its file keeps all else.

        Args:
            values: by path (see `numbers`), in SI or as a text with a unit. "control.kp" is the gain of all motors,
                "control.kp.arm" that of one where the file has a list.

        Returns:
            The new robot; its `path` is None, for no file holds it yet.

        Raises:
            UpdateError: a path is unknown or a value is not a finite number.
            RobotFileError: a value is out of its bounds or impossible (a negative stiffness).
        """
        return Robot._from_document(write(self._document, self._numbers, values), None)

    def to_yaml(self) -> str:
        """The text of the robot's file, with every comment."""
        return self._document.text

    def save(self, path: str | Path) -> None:
        """Write the robot to a file, whole or not at all.

        A robot that starts from a URDF refers to it from the new place. If the URDF's file has gone or changed
        since it was read, a copy is put beside the robot.

        Raises:
            DataFileError: the file cannot be written, or the copy would replace another file.
        """
        text = self.to_yaml()
        if isinstance(self._document, UrdfDocument):
            text, copy = self._document.moved(Path(path))
            if copy is not None:
                write_whole(copy, self._document.urdf.content)
        write_whole(path, text.encode())


def _restore(text: str, path: Path | None, origin: str, urdf: Urdf | None) -> Robot:
    document = Document(text, origin)
    return Robot._from_document(document if urdf is None else UrdfDocument(document, urdf), path)


def _listed_values(values: object) -> list[object] | None:
    if isinstance(values, np.ndarray):
        return list(values.tolist()) if values.ndim == 1 else None
    if not isinstance(values, Sequence):
        return None
    return list(values)


def _unknown(where: str, name: object, expected: str, known: Iterable[str]) -> PostureError:
    names = list(known)
    hint = did_you_mean(str(name), names) or (f"There is {listed(names)}." if names else "The file has none.")
    return PostureError(where, found=shown(name), expected=expected, hint=hint)
