"""A YAML text with its plain data, the place of every value in it, and edits that leave the rest alone."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Final

from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError, YAMLError, YAMLStreamError
from ruamel.yaml.events import (
    AliasEvent,
    CollectionEndEvent,
    CollectionStartEvent,
    DocumentStartEvent,
    MappingStartEvent,
    NodeEvent,
    ScalarEvent,
)

from armonic.description.units import shown
from armonic.errors import RobotFileError

MAX_BYTES: Final = 1 << 20
MAX_DEPTH: Final = 16

Location = tuple[str | int, ...]
"""Keys and list indices from the top of the file to a value."""

_NULLS = frozenset({"", "~", "null", "Null", "NULL"})
_BOOLS = {"true": True, "True": True, "TRUE": True, "false": False, "False": False, "FALSE": False}
_INTEGER = re.compile(r"[+-]?\d{1,18}", re.ASCII)
_FLOAT = re.compile(r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?", re.ASCII)
_NOT_FINITE = re.compile(r"[+-]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)")


@dataclass(slots=True)
class Node:
    """One value of the text: its plain data and where it stands."""

    data: Any
    start: int
    end: int
    line: int
    column: int
    flow: bool
    keys: dict[str, Node] = field(default_factory=dict)
    items: dict[str | int, Node] = field(default_factory=dict)


class Document:
    """A YAML text and its data: mappings, lists, texts, numbers, booleans and None; nothing else is built.

    Numbers are decimal; what YAML would make a date, a hexadecimal number or a merge stays a text.

    Args:
        text: the YAML text.
        origin: the file's name for error messages.
        data: what the text is known to hold; it is then parsed only where a place in it is asked for.

    Raises:
        RobotFileError: the text is not one well-formed YAML document, or uses anchors, aliases, tags,
            directives, duplicate keys, keys that are not texts, or nesting deeper than `MAX_DEPTH`.
    """

    def __init__(self, text: str, origin: str, data: Any = None) -> None:
        if len(text) > MAX_BYTES:
            raise _too_large(origin)
        self.text, self.origin = text, origin
        self._data = self.root.data if data is None else data

    @cached_property
    def root(self) -> Node:
        """The value that the whole text is, with all others in it."""
        return _Reader(self.text, self.origin).read()

    @property
    def data(self) -> Any:
        """The plain data of the whole text."""
        return self._data

    @cached_property
    def tried(self) -> set[frozenset[Location]]:
        """The places where keys were added together and the text was found to hold what it should."""
        return set()

    def holds(self, location: Location) -> bool:
        """Whether the text is where the value at a location stands, or would stand."""
        return self._placed(location) is not None

    def _placed(self, location: Location) -> Location | None:
        return location

    def node(self, location: Location) -> Node:
        """The value at a location, or the last one on the way to it that exists."""
        node = self.root
        for part in location:
            if part not in node.items:
                break
            node = node.items[part]
        return node

    def key(self, location: Location) -> Node:
        """The key that names the value at a location; the value itself where there is no key."""
        parent = self.node(location[:-1])
        return parent.keys.get(str(location[-1]), parent) if location else parent

    def where(self, location: Location, *, at_key: bool = False) -> str:
        """File, line and dotted path, with list entries called by their `name` where they have one."""
        node = self.key(location) if at_key else self.node(location)
        path = dotted(location, self.root.data)
        return f"{self.origin}, line {node.line}" + (f", {path}" if path else "")

    def edited(self, edits: Iterable[tuple[int, int, str]]) -> Document:
        """A new document with spans (start, end) of the text replaced; spans must not overlap."""
        return Document(self._spliced(edits), self.origin)

    def edited_into(self, data: Any, edits: Iterable[tuple[int, int, str]]) -> Document:
        """As `edited`, where the data of the new text is known: parsing takes longer than all else of a change."""
        if type(self) is not Document:  # there is more to its data than the text
            return self.edited(edits)
        return Document(self._spliced(edits), self.origin, data)

    def _spliced(self, edits: Iterable[tuple[int, int, str]]) -> str:
        text = self.text
        for start, end, new in sorted(edits, reverse=True):
            text = text[:start] + new + text[end:]
        return text


def dotted(location: Location, data: Any) -> str:
    """A location as a dotted path: ("links", 2, "mass") is "links.arm.mass"."""
    path = ""
    for part in location:
        if isinstance(data, Mapping):
            data = data.get(part)
            path += f".{_clipped(str(part))}" if path else _clipped(str(part))
        elif isinstance(data, list) and isinstance(part, int) and part < len(data):
            data = data[part]
            name = data.get("name") if isinstance(data, Mapping) else None
            path += f".{_clipped(name)}" if isinstance(name, str) and name else f"[{part}]"
        else:
            break
    return path


def is_file(path: Path) -> bool:
    """Whether there is a regular file; False where the path is one that no file can have."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def read_text(path: Path) -> str:
    """The text of a file of at most 1 MiB in UTF-8, line ends as they are.

    Raises:
        RobotFileError: the file cannot be read, is no regular file, is too large, or is not UTF-8.
    """
    origin = str(path)
    if not is_file(path):
        raise RobotFileError(origin, found="no file there", expected="a robot file (YAML)")
    try:
        with path.open("rb") as file:
            content = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise RobotFileError(origin, found=error.strerror or str(error), expected="a readable file") from error
    if len(content) > MAX_BYTES:
        raise _too_large(origin)
    try:
        return content.decode("utf-8").removeprefix("\ufeff")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise RobotFileError(
            f"{origin}, line {line}", found=f"the byte 0x{content[error.start]:02x}", expected="text in UTF-8"
        ) from error


class _Reader:
    """Builds nodes from the parser's events, without recursion, and refuses what no robot file needs."""

    def __init__(self, text: str, origin: str) -> None:
        self.text, self.origin = text, origin
        self.root: Node | None = None
        # The collections around the next value, the way to the innermost, and the key each waits with.
        self.open: list[Node] = []
        self.path: list[str | int] = []
        self.pending_key: list[Node | None] = []
        self.documents = 0
        self.line = 1

    def read(self) -> Node:
        try:
            for event in YAML(typ="safe", pure=True).parse(self.text):
                self.take(event)
        except RobotFileError:
            raise
        except MarkedYAMLError as error:
            raise self.syntax_refusal(error) from error
        except YAMLError as error:
            # The only unmarked one is the reader's, about a character.
            line = self.text.count("\n", 0, getattr(error, "position", 0)) + 1
            raise self.refusal(line, "a character that YAML does not allow", "printable text") from error
        except (
            YAMLStreamError,
            ValueError,
            OverflowError,
            LookupError,
            AttributeError,
            AssertionError,
        ) as error:
            # Broken escapes and directives end in stray exceptions inside the parser.
            found = f"text the YAML parser fails on ({type(error).__name__})"
            raise self.refusal(self.line, found, "well-formed YAML") from error
        if self.root is None:
            raise self.refusal(1, "an empty file", "a robot description that starts with `armonic: 1`")
        return self.root

    def take(self, event: Any) -> None:
        line = self.line = event.start_mark.line + 1
        if isinstance(event, DocumentStartEvent):
            self.documents += 1
            if self.documents > 1:
                raise self.refusal(line, "a second document (`---`)", "one document per file")
            if event.version or event.tags:
                lines = enumerate(self.text.splitlines(), 1)
                line = next((i for i, text in lines if text.startswith("%")), line)
                hint = "Remove the lines that start with %."
                raise self.refusal(line, "a YAML directive (`%`)", "none", hint)
        elif isinstance(event, CollectionEndEvent):
            node = self.open.pop()
            self.pending_key.pop()
            del self.path[max(len(self.open) - 1, 0) :]
            node.end = event.end_mark.index
        elif isinstance(event, NodeEvent):
            self.refuse_features(event, line)
            self.place(self.node(event), is_collection=isinstance(event, CollectionStartEvent))

    def refuse_features(self, event: Any, line: int) -> None:
        if isinstance(event, AliasEvent) or event.anchor is not None:
            sign = "alias (`*" if isinstance(event, AliasEvent) else "anchor (`&"
            hint = "Write the values out where they are used."
            raise self.refusal(line, f"a YAML {sign}{_clipped(str(event.anchor))}`)", "plain values", hint)
        if event.tag is not None:
            hint = "Remove the tag; a robot file holds texts, numbers, lists and mappings only."
            raise self.refusal(line, f"the YAML tag {_clipped(str(event.tag))}", "plain values", hint)
        if isinstance(event, CollectionStartEvent) and len(self.open) >= MAX_DEPTH:
            raise self.refusal(line, f"nesting deeper than {MAX_DEPTH} levels", "the levels of a robot file")

    def node(self, event: Any) -> Node:
        start, end = event.start_mark, event.end_mark
        data: Any
        if isinstance(event, ScalarEvent):
            data = event.value if event.style else _plain(event.value)
            if isinstance(data, str) and not all(c.isprintable() or c in "\n\t" for c in data):
                raise self.refusal(start.line + 1, "a control character", "printable text")
            # Marks of block scalars (| and >) run on to the next line; the value ends before.
            end_index = start.index + len(self.text[start.index : end.index].rstrip())
            return Node(data, start.index, end_index, start.line + 1, start.column, flow=True)
        data = {} if isinstance(event, MappingStartEvent) else []
        return Node(data, start.index, end.index, start.line + 1, start.column, flow=bool(event.flow_style))

    def place(self, node: Node, *, is_collection: bool) -> None:
        parent = self.open[-1] if self.open else None
        part: str | int | None = None
        if parent is None:
            self.root = node
        elif isinstance(parent.data, list):
            part = len(parent.data)
            parent.data.append(node.data)
        elif (key := self.pending_key[-1]) is None:
            self.take_key(node, parent)
        else:
            part = key.data
            if node.start == node.end:
                # The parser places a missing value at whatever comes next.
                node.line, node.column, node.start, node.end = key.line, key.column, key.end, key.end
            parent.keys[key.data] = key
            parent.data[key.data] = node.data
            self.pending_key[-1] = None
        if parent is not None and part is not None:
            parent.items[part] = node
        if is_collection:
            self.open.append(node)
            self.pending_key.append(None)
            if part is not None:
                self.path.append(part)

    def take_key(self, key: Node, parent: Node) -> None:
        if not isinstance(key.data, str):
            hint = f"Put it in quotes: '{key.data}'." if isinstance(key.data, int | float) else None
            found = "a collection" if isinstance(key.data, dict | list) else shown(key.data)
            raise self.refusal(key.line, f"{found} as a key", "a key that is a text", hint)
        if key.data in parent.keys:
            first = parent.keys[key.data].line
            raise self.refusal(key.line, f"the key {shown(key.data)} again", f"it once (first on line {first})")
        self.pending_key[-1] = key

    def syntax_refusal(self, error: MarkedYAMLError) -> RobotFileError:
        mark, start = error.problem_mark or error.context_mark, error.context_mark
        hint = None
        if error.context and start is not None:
            hint = f"It fails {_one_line(error.context)} that starts on line {start.line + 1}."
        last = max(1, len(self.text.splitlines()))
        found = f"a syntax error ({_one_line(error.problem or error.context)})"
        return self.refusal(min(mark.line + 1, last) if mark else 1, found, "well-formed YAML", hint)

    def refusal(self, line: int, found: str, expected: str, hint: str | None = None) -> RobotFileError:
        names = list(self.path)
        if self.open and isinstance(self.open[-1].data, list):
            names.append(len(self.open[-1].data))
        elif self.open and (key := self.pending_key[-1]) is not None:
            names.append(key.data)
        path = dotted(tuple(names), self.root.data if self.root else None)
        where = f"{self.origin}, line {line}" + (f", {path}" if path else "")
        return RobotFileError(where, found=found, expected=expected, hint=hint)


def _plain(text: str) -> Any:
    """The data of an unquoted scalar."""
    if text in _NULLS:
        return None
    if text in _BOOLS:
        return _BOOLS[text]
    if _INTEGER.fullmatch(text):
        return int(text)
    if _FLOAT.fullmatch(text):
        return float(text)
    if _NOT_FINITE.fullmatch(text):
        return math.nan if "n" in text[-1].lower() else math.inf
    return text


def _clipped(text: str) -> str:
    text = text if text.isprintable() else repr(text)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _one_line(text: object) -> str:
    return _clipped(" ".join(str(text).split()))


def _too_large(origin: str) -> RobotFileError:
    return RobotFileError(origin, found="more than 1 MiB", expected="a robot file of a few kilobytes")
