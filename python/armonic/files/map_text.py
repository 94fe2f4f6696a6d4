"""The text of a channel map, YAML or CSV, as entries that know their lines."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path

from armonic.description.document import Document, Location, read_text
from armonic.description.names import did_you_mean
from armonic.errors import DataFileError, RobotFileError
from armonic.files.map_entry import KEYS, Entry, entry
from armonic.files.uff_reader import shown

_TOP = ("armonic_channels", "channels", "strict")
_BEGIN = "a channel map that starts with `armonic_channels: 1`"
_COLUMNS = tuple(key for key in KEYS if key != "rotate")
_HEADER = f"a header of {', '.join(_COLUMNS)}"


def entries_of(path: str | Path) -> tuple[tuple[Entry, ...], bool]:
    """The entries of a map and whether it is strict.

    Args:
        path: a file of YAML, or of CSV if its name says so.

    Raises:
        DataFileError: it is no such file, or an entry does not make sense.
    """
    try:
        text = read_text(Path(path))
        if not text.strip():
            raise DataFileError(str(path), found="an empty file", expected=_BEGIN)
        return _in_csv(path, text) if Path(path).suffix.lower() == ".csv" else _in_yaml(Document(text, str(path)))
    except RobotFileError as error:
        found, expected = (
            t.replace("a robot file (YAML)", "a channel map")
            .replace("robot file", "channel map")
            .replace("a robot description that starts with `armonic: 1`", _BEGIN)
            for t in (error.found, error.expected)
        )
        hint = error.hint and error.hint.replace("robot file", "channel map")
        raise DataFileError(error.where, found=found, expected=expected, hint=hint) from None


def _in_yaml(document: Document) -> tuple[tuple[Entry, ...], bool]:
    data = document.data
    if not isinstance(data, dict):
        raise DataFileError(document.where(()), found=shown(str(data)), expected=_BEGIN)
    for key in data:
        if key not in _TOP:
            where, hint = document.where((key,), at_key=True), did_you_mean(key, _TOP)
            found = f"the unknown key {shown(key)}"
            raise DataFileError(where, found=found, expected=f"one of {', '.join(_TOP)}", hint=hint)
    version = data.get("armonic_channels")
    if version != 1 or isinstance(version, bool):
        found = "no armonic_channels" if version is None else f"armonic_channels: {shown(str(version))}"
        where = document.where(("armonic_channels",) if "armonic_channels" in data else ())
        raise DataFileError(where, found=found, expected=_BEGIN)
    strict, listed = data.get("strict", False), data.get("channels")
    if not isinstance(strict, bool):
        raise DataFileError(document.where(("strict",)), found=shown(str(strict)), expected="true or false")
    if not isinstance(listed, list) or not listed:
        found = "no channels" if not listed else shown(str(listed))
        raise DataFileError(document.where(("channels",)), found=found, expected="a list of entries")
    entries = []
    for k, fields in enumerate(listed):
        at: Location = ("channels", k)
        if not isinstance(fields, dict):
            expected = 'an entry such as {channel: "Ch 1", place: sensor, axis: -z}'
            raise DataFileError(document.where(at), found=shown(str(fields)), expected=expected)

        entries.append(entry(fields, _placed(document, at), document.node(at).line))
    return tuple(entries), strict


def _in_csv(path: str | Path, text: str) -> tuple[tuple[Entry, ...], bool]:
    lines = [(k, line) for k, line in enumerate(text.splitlines(), 1) if line.strip()]
    comments = ["".join(line.lower().split()) for _, line in lines if line.startswith("#")]
    table = [(k, line) for k, line in lines if not line.startswith("#")]
    if not table:
        raise DataFileError(str(path), found="no table", expected=_HEADER)
    mark = ";" if ";" in table[0][1] and "," not in table[0][1] else ","
    header = [word.strip().lower() for word in _words(f"{path}, line {table[0][0]}", table[0][1], mark)]
    for k, word in enumerate(header):
        if word not in _COLUMNS or word in header[:k]:
            found = f"column {shown(word)}" + (" twice" if word in header[:k] else "")
            hint = did_you_mean(word, _COLUMNS) if word not in _COLUMNS else None
            raise DataFileError(f"{path}, line {table[0][0]}", found=found, expected=_HEADER, hint=hint)
    if len(table) == 1:
        raise DataFileError(str(path), found="a header and no entry", expected="at least one line")
    entries = []
    for number, line in table[1:]:
        place = f"{path}, line {number}"
        words = [word.strip() for word in _words(place, line, mark)]
        if len(words) != len(header):
            raise DataFileError(place, found=f"{len(words)} values", expected=f"{len(header)}, one per column")
        if mark == ";" and "scale" in header:  # such tables have decimal commas
            words[header.index("scale")] = words[header.index("scale")].replace(",", ".")
        fields = dict(zip(header, words, strict=True))

        entries.append(entry(fields, _columned(place), number))
    return tuple(entries), "#strict:true" in comments


def _placed(document: Document, at: Location) -> Callable[[str], str]:
    """From a key of an entry to its place in the text."""
    return lambda key: document.where((*at, key), at_key=True) if key else document.where(at)


def _columned(place: str) -> Callable[[str], str]:
    return lambda key: f"{place}, {key}" if key else place


def _words(place: str, line: str, mark: str) -> list[str]:
    try:
        return next(csv.reader([line], delimiter=mark, strict=True, skipinitialspace=True))
    except (csv.Error, StopIteration) as error:
        raise DataFileError(place, found=f"a line that cannot be split ({error})", expected=_HEADER) from error
