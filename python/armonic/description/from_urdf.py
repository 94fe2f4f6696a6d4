"""A robot file that starts from a URDF: both joined into one document, every error placed in the file it comes from."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Final

from armonic.description.document import Document, Location, Node, is_file
from armonic.description.fields import FieldError, Found
from armonic.description.names import did_you_mean
from armonic.description.plain_xml import foreign_address, read_bytes
from armonic.description.reading import refusal
from armonic.description.units import shown
from armonic.description.urdf import Urdf, read_urdf
from armonic.errors import DataFileError, RobotFileError

OF_JOINTS: Final = ("elasticity", "drive")
"""What a robot file adds to the joints of a URDF."""

_SUFFIXES = frozenset({".urdf", ".xacro", ".xml"})


class UrdfDocument(Document):
    """A robot file whose data has the links of a URDF, with what the file adds to their joints.

    Its places are those of the robot file or, for what the URDF gives, of the URDF.

    Args:
        document: the robot file by itself.
        urdf: the URDF that it starts from.

    Raises:
        RobotFileError: the file has links of its own, or names joints that the URDF does not have or move.
    """

    def __init__(self, document: Document, urdf: Urdf) -> None:
        self.text, self.origin, self.root = document.text, document.origin, document.root
        self.urdf = urdf
        errors = list(self._errors())
        if errors:
            raise refusal(self, errors)
        self._joined = self._join()

    @property
    def data(self) -> Any:
        """The plain data of the robot file, with the links of the URDF in place of `joints`."""
        return self._joined

    def node(self, location: Location) -> Node:
        """The value at a location; `urdf` for what the URDF gives."""
        placed = self._placed(location)
        return super().node(("urdf",) if placed is None else placed)

    def key(self, location: Location) -> Node:
        """The key that names the value at a location; `urdf` for what the URDF gives."""
        placed = self._placed(location)
        return super().key(("urdf",) if placed is None else placed)

    def where(self, location: Location, *, at_key: bool = False) -> str:
        """File, line and dotted path; line and joint or link for what the URDF gives."""
        placed = self._placed(location)
        if placed is None:
            return self.urdf.where(int(location[1]), location[2] if len(location) > 2 else None)
        return super().where(placed, at_key=at_key)

    def edited(self, edits: Iterable[tuple[int, int, str]]) -> UrdfDocument:
        """A new document with spans of the robot file's text replaced, and the same URDF."""
        return UrdfDocument(super().edited(edits), self.urdf)

    def moved(self, target: Path) -> tuple[str, Path | None]:
        """What to write so that the robot can be loaded from another place.

        Args:
            target: where the robot file will be.

        Returns:
            Its text, whose `urdf` leads from there to the URDF; and where to put a copy of the URDF, None
            where its file is still what was loaded.

        Raises:
            DataFileError: the target is the URDF, its path cannot be written in a text, or a copy would replace
                another file.
        """
        folder, path, copy = target.absolute().parent, self.urdf.path, None
        if not self._is_at(path):
            path = folder / path.name
            if not self._is_at(path):
                copy = path
                if not _same(target, path) and os.path.lexists(path):
                    found = "a file that is not the URDF which was loaded"
                    hint = "Save to another folder, or load the robot again."
                    raise DataFileError(str(path), found=found, expected="room for a copy of that URDF", hint=hint)
        if _same(target, path):
            raise DataFileError(str(target), found="the URDF that the robot starts from", expected="another file")
        node = self.root.items["urdf"]
        if _same(_find(str(node.data), folder), path):
            return self.text, copy
        reference = _reference(path, folder)
        if not reference.isprintable():
            raise DataFileError(
                str(target), found=f"the path {shown(reference)} of the URDF", expected="a printable path"
            )
        return self.text[: node.start] + json.dumps(reference, ensure_ascii=False) + self.text[node.end :], copy

    def _is_at(self, path: Path) -> bool:
        try:
            return read_bytes(path) == self.urdf.content
        except RobotFileError:
            return False

    def _placed(self, at: Location) -> Location | None:
        """Where the robot file has a value of the joined data; None if the URDF has it."""
        if at[:1] == ("links",) and len(at) > 1:
            joint = self.urdf.joints[int(at[1])]
            is_added = len(at) > 2 and at[2] in OF_JOINTS
            return ("joints", joint, *at[2:]) if joint is not None and is_added else None
        if at[:1] == ("postures",) and len(at) > 2 and isinstance(at[2], int):
            values = self.root.data["postures"][at[1]]
            if isinstance(values, dict):
                return ("postures", at[1], self.urdf.moving[at[2]], *at[3:])
        return at

    def _join(self) -> dict[str, Any]:
        file: dict[str, Any] = self.root.data
        joints, joined = file.get("joints", {}), {key: value for key, value in file.items() if key != "joints"}
        links = zip(self.urdf.links, self.urdf.joints, strict=True)
        joined["links"] = [{**link, **joints.get(joint, {})} for link, joint in links]
        postures = file.get("postures")
        if isinstance(postures, dict):
            joined["postures"] = {name: self._in_order(values) for name, values in postures.items()}
        return joined

    def _in_order(self, posture: Any) -> Any:
        return [posture.get(joint, 0.0) for joint in self.urdf.moving] if isinstance(posture, dict) else posture

    def _errors(self) -> Iterator[FieldError]:
        file: dict[str, Any] = self.root.data
        if "links" in file:
            yield _at_key(FieldError(Found("links beside a urdf"), "one of the two", at=("links",)))
        joints = file.get("joints", {})
        if not isinstance(joints, dict):
            yield FieldError(joints, "a mapping of joint names", at=("joints",))
            joints = {}
        for name, entry in joints.items():
            at = ("joints", name)
            if name not in self.urdf.joints:
                yield self._unknown(name, at, [joint for joint in self.urdf.joints if joint is not None])
            elif not isinstance(entry, dict):
                yield FieldError(entry, f"a mapping with {' or '.join(OF_JOINTS)}", at=at)
            else:
                for key in entry.keys() - OF_JOINTS:
                    hint = did_you_mean(key, OF_JOINTS) or "All else of a joint stands in the URDF."
                    error = FieldError(Found(f"the unknown key {shown(key)}"), f"one of {', '.join(OF_JOINTS)}", hint)
                    error.at = (*at, key)
                    yield _at_key(error)
        postures = file.get("postures")
        for name, values in postures.items() if isinstance(postures, dict) else ():
            for joint in values.keys() - self.urdf.moving if isinstance(values, dict) else ():
                yield self._unknown(joint, ("postures", name, joint), list(self.urdf.moving), "that moves ")

    def _unknown(self, name: str, at: Location, known: list[str], which: str = "") -> FieldError:
        found, expected = Found(f"the unknown joint {shown(name)}"), f"the name of a joint {which}in {self.urdf.origin}"
        error = _at_key(FieldError(found, expected, at=at))
        carriers = {link["name"]: joint for link, joint in zip(self.urdf.links, self.urdf.joints, strict=True)}
        if name in self.urdf.joints:
            error.hint = "It is fixed."
        elif carriers.get(name) in known:
            error.hint = f"That is a link; its joint is {shown(carriers[name])}."
        else:
            error.suggest = lambda: did_you_mean(name, known)
        return error


def with_urdf(document: Document, folder: Path) -> Document:
    """A robot file together with the URDF that it names; the same document if it names none.

    Args:
        document: the robot file.
        folder: its folder, where relative paths start, and where package://name/path is looked for as
            name/path, then as path.

    Raises:
        RobotFileError: the reference is no path of a file, or the URDF cannot be used.
    """
    data = document.data
    if not isinstance(data, dict) or "urdf" not in data:
        return document
    reference, place = data["urdf"], document.where(("urdf",))
    if not isinstance(reference, str) or not reference.strip():
        raise RobotFileError(place, found=shown(reference), expected="the path of a URDF, relative to this file")
    if foreign_address(reference):
        hint = "Armonic fetches nothing: download it first."
        raise RobotFileError(place, found=f"the address {shown(reference)}", expected="the path of a file", hint=hint)
    path = _find(reference, folder)
    if not is_file(path):
        raise RobotFileError(place, found=f"no file {shown(str(path))}", expected="the path of a URDF")
    return UrdfDocument(document, read_urdf(read_bytes(path), path.absolute(), str(path)))


def is_urdf(path: Path) -> bool:
    """Whether a file is to be read as URDF: by its suffix, or because it starts as XML does."""
    if path.suffix.lower() in _SUFFIXES:
        return True
    try:
        with path.open("rb") as file:
            return file.read(256).lstrip(b"\xef\xbb\xbf\t\n\r ").startswith(b"<")
    except OSError:
        return False


def from_urdf(path: Path) -> UrdfDocument:
    """The robot file that says no more than which URDF to start from.

    Raises:
        RobotFileError: the URDF cannot be used.
    """
    urdf = read_urdf(read_bytes(path), path.absolute(), str(path))
    printable = "".join(letter if letter.isprintable() else " " for letter in urdf.name)
    name = " ".join(printable.split())[:200] or "robot"
    quoted = (json.dumps(text, ensure_ascii=False) for text in (name, path.name))
    return UrdfDocument(Document("armonic: 1\nname: {}\nurdf: {}\n".format(*quoted), str(path)), urdf)


def _find(reference: str, folder: Path) -> Path:
    if not reference.startswith("package://"):
        return folder / reference
    name = reference.removeprefix("package://").lstrip("/")
    inside = folder / name.partition("/")[2]
    return inside if is_file(inside) and not is_file(folder / name) else folder / name


def _reference(path: Path, folder: Path) -> str:
    """The path from a folder to a file: relative where that leads there, for links may bend the way."""
    try:
        relative = os.path.relpath(path, folder)
    except ValueError:  # another drive
        return str(path)
    return Path(relative).as_posix() if not path.exists() or _same(folder / relative, path) else str(path)


def _same(one: Path, other: Path) -> bool:
    try:
        return one.resolve() == other.resolve()
    except (OSError, RuntimeError, ValueError):
        return False


def _at_key(error: FieldError) -> FieldError:
    error.at_key = True
    return error
