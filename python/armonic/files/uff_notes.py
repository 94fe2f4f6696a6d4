"""What universal files have no field for, in a data set that others pass over: names of places, and notes."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

from armonic.files.uff_writer import ascii_lines

NOTES = 9151
"""Number of the data set; no program that we know of has one of this number."""
LONGEST = 1 << 24
"""Characters of notes that are read."""
_MARK = "> "
_WIDTH = 76


class Notes(NamedTuple):
    """Names and notes of a file.

    Attributes:
        places: the place of each node.
        records: notes of each record, by its number from 1.
        frfs: notes of the frequency responses.
    """

    places: Mapping[int, str]
    records: Mapping[int, Mapping[str, str]]
    frfs: Mapping[str, str]


def encode_notes(notes: Notes) -> bytes:
    """The data set: JSON in ASCII, in lines that begin with a mark; notes that all records share stand once."""
    records = list(notes.records.values())
    shared = {
        name: text
        for name, text in (records[0] if records else {}).items()
        if all(other.get(name) == text for other in records)
    }
    own = {
        str(number): rest
        for number, of_record in notes.records.items()
        if (rest := {name: text for name, text in of_record.items() if name not in shared})
    }
    told = {
        "places": {str(node): place for node, place in notes.places.items()},
        "notes": shared,
        "records": own,
        "frfs": dict(notes.frfs),
    }
    text = json.dumps({name: part for name, part in told.items() if part})
    rows = (_MARK + text[k : k + _WIDTH] + "<" for k in range(0, len(text), _WIDTH))
    return ascii_lines(["    -1", f"{NOTES:6d}", *rows, "    -1"])


def decode_notes(lines: Iterable[str]) -> tuple[Notes, dict[str, str]]:
    """The notes in the lines of the data set, and those that every record has; what is damaged is as if not there."""
    parts, length = [], 0
    for line in lines:
        parts.append(line.rstrip().removeprefix(_MARK).removesuffix("<"))
        length += len(parts[-1])
        if length > LONGEST:
            break
    try:
        told = json.loads("".join(parts))
    except (ValueError, RecursionError):
        told = {}
    told = told if isinstance(told, dict) else {}
    places = {int(node): place for node, place in _texts(told.get("places")).items() if _is_node(node) and place}
    own = told.get("records")
    records = {int(k): _texts(v) for k, v in own.items() if _is_node(k)} if isinstance(own, dict) else {}
    return Notes(places, records, _texts(told.get("frfs"))), _texts(told.get("notes"))


def _is_node(text: str) -> bool:
    return text.isascii() and text.isdecimal() and len(text) <= 10


def _texts(given: Any) -> dict[str, str]:
    return {k: v for k, v in given.items() if isinstance(v, str)} if isinstance(given, dict) else {}
