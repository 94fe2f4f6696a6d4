"""XML that stands alone: parsed without entities, includes, instructions or addresses, each refused with its line."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Final

from armonic.description.document import is_file
from armonic.description.units import shown
from armonic.errors import RobotFileError

if TYPE_CHECKING:
    from lxml import etree

MAX_BYTES: Final = 4 << 20
MAX_ATTRIBUTES: Final = 100
"""Of one element: the time to read them grows with their square."""

RUN_XACRO: Final = "Run xacro first, and give Armonic what it writes: xacro robot.urdf.xacro > robot.urdf"

_DECLARATION = re.compile(r"<\?xml\s[^<>]*\?>")
_ADDRESS = re.compile(r"\s*([A-Za-z][A-Za-z0-9+.-]*)://")
_SPACES = frozenset("\t\n\r ")
_LOCAL = frozenset({"package", "file", "model"})
"""Schemes that name files of this machine. Nothing opens them either."""


def read_bytes(path: Path) -> bytes:
    """The content of a file of at most 4 MiB.

    Raises:
        RobotFileError: the file cannot be read, is no regular file, or is too large.
    """
    if not is_file(path):
        raise RobotFileError(str(path), found="no file there", expected="a URDF")
    try:
        with path.open("rb") as file:
            content = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise RobotFileError(str(path), found=error.strerror or str(error), expected="a readable file") from error
    return content


def parse(content: bytes, origin: str) -> etree._Element:
    """The root element of an XML text in UTF-8, whatever encoding it declares.

    Nothing is expanded, fetched or opened. Comments are left out.

    Args:
        content: the bytes of the text.
        origin: the file's name for error messages.

    Raises:
        RobotFileError: the text is too large, not in UTF-8 or not well-formed; it has a DOCTYPE, an entity, a
            processing instruction, an XInclude, what xacro would replace, or an address of another machine.
    """
    from lxml import etree

    if len(content) > MAX_BYTES:
        raise RobotFileError(origin, found=f"more than {MAX_BYTES >> 20} MiB", expected="a URDF of some kilobytes")
    text = _decoded(content, origin)
    _refuse_prolog(text, origin)
    parser = etree.XMLParser(
        encoding="utf-8",
        resolve_entities=False,
        no_network=True,
        load_dtd=False,
        dtd_validation=False,
        huge_tree=False,
        remove_comments=True,
    )
    try:
        root = etree.fromstring(text.encode(), parser)
    except (etree.LxmlError, ValueError, LookupError) as error:
        raise _syntax_refusal(error, origin) from None
    if root.getroottree().docinfo.internalDTD is not None:
        raise _doctype(origin, 1)
    for element in (*root.iter(), *root.itersiblings(), *root.itersiblings(preceding=True)):
        _refuse_features(element, origin)
    return root


def line_of(element: etree._Element) -> int:
    """The line that an element starts on."""
    line: int | None = getattr(element, "sourceline", None)
    return line or 1


def where(element: etree._Element, origin: str) -> str:
    """File and line of an element, and the link or joint that it belongs to."""
    place = f"{origin}, line {line_of(element)}"
    for owner in (element, *element.iterancestors()):
        if owner.tag in ("link", "joint") and (name := owner.get("name", "").strip()):
            return f"{place}, {owner.tag} {clipped(name)}"
    return place


def foreign_address(text: str) -> bool:
    """Whether a text is the address (scheme://...) of something that is no file of this machine."""
    address = _ADDRESS.match(text)
    return address is not None and address[1].lower() not in _LOCAL


def clipped(text: str) -> str:
    """A name for an error message, on one line and in at most 60 characters."""
    text = text if text.isprintable() else repr(text)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _decoded(content: bytes, origin: str) -> str:
    hint = "Save it in UTF-8."
    try:
        text = content.decode("utf-8").removeprefix("\ufeff")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        found = f"the byte 0x{content[error.start]:02x}"
        raise RobotFileError(f"{origin}, line {line}", found=found, expected="text in UTF-8", hint=hint) from None
    if "\0" in text:
        line = text.count("\n", 0, text.index("\0")) + 1
        raise RobotFileError(f"{origin}, line {line}", found="the byte 0x00", expected="text in UTF-8", hint=hint)
    return text


def _refuse_prolog(text: str, origin: str) -> None:
    """Refuse what may only stand before the root element, before any parser sees it."""
    declaration = _DECLARATION.match(text)
    at = declaration.end() if declaration else 0
    while True:
        while text[at : at + 1] in _SPACES:
            at += 1
        if not text.startswith("<!--", at):
            break
        end = text.find("-->", at + 4)
        if end < 0:
            return  # the parser says so
        at = end + 3
    line = text.count("\n", 0, at) + 1
    if text.startswith("<!", at):
        raise _doctype(origin, line)
    if text.startswith("<?", at):
        raise _instruction(f"{origin}, line {line}")


def _refuse_features(element: etree._Element, origin: str) -> None:
    from lxml import etree

    if not isinstance(element.tag, str):
        place = where(element, origin)
        if element.tag is etree.ProcessingInstruction:
            raise _instruction(place)
        raise RobotFileError(place, found="an entity", expected="plain text")  # pragma: no cover - no DTD, no entity
    if len(element.attrib) > MAX_ATTRIBUTES:
        found = f"an element with {len(element.attrib)} attributes"
        raise RobotFileError(where(element, origin), found=found, expected=f"at most {MAX_ATTRIBUTES}")
    names = [etree.QName(name) for name in (element.tag, *element.attrib)]
    for name in names:
        space = (name.namespace or "").lower()
        if "xinclude" in space:
            found, hint = "an XInclude", "Put the content in its place."
            raise RobotFileError(where(element, origin), found=found, expected="one whole file", hint=hint)
        if "xacro" in space:
            found = f"the xacro element or attribute {clipped(name.localname)}"
            raise RobotFileError(where(element, origin), found=found, expected="a URDF", hint=RUN_XACRO)
    for value in (*element.attrib.values(), element.text or "", element.tail or ""):
        if "${" in value or "$(" in value:
            found = f"what xacro would replace, {shown(value)}"
            raise RobotFileError(where(element, origin), found=found, expected="a URDF", hint=RUN_XACRO)
        if foreign_address(value):
            found = f"the address {shown(value.strip())}"
            hint = "Armonic fetches nothing: keep the file on this machine, or remove the reference."
            raise RobotFileError(where(element, origin), found=found, expected="package:// or a path", hint=hint)


def _doctype(origin: str, line: int) -> RobotFileError:
    hint = "Remove it: a URDF needs no entities."
    return RobotFileError(f"{origin}, line {line}", found="a DOCTYPE", expected="the element <robot>", hint=hint)


def _instruction(place: str) -> RobotFileError:
    return RobotFileError(place, found="a processing instruction (<?...?>)", expected="elements", hint="Remove it.")


def _syntax_refusal(error: Exception, origin: str) -> RobotFileError:
    message = " ".join(str(getattr(error, "msg", error)).split())
    problem, line = re.sub(r", line \d+, column \d+$", "", message), getattr(error, "lineno", None) or 1
    problem = problem if len(problem) <= 100 and problem.isprintable() else clipped(problem)
    return RobotFileError(
        f"{origin}, line {line}",
        found=f"a syntax error ({problem})",
        expected="well-formed XML",
        hint=RUN_XACRO if "prefix xacro" in problem else None,
    )
