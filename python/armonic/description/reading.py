"""From a YAML document to a checked description: every error is placed by file, line and dotted path."""

from __future__ import annotations

import difflib
import types
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError

from armonic.description.document import Document, Location
from armonic.description.fields import FieldError, Found, measured
from armonic.description.schema import Link, RobotDescription
from armonic.description.units import shown
from armonic.errors import RobotFileError

SUGGESTIONS = 20
"""So many errors of a file get the nearest known name, which is slow to find among thousands."""


def read_description(document: Document) -> RobotDescription:
    """Check a document against the schema, and its names against each other.

    Args:
        document: the YAML text of a robot file.

    Returns:
        The description, everything in SI, postures as numbers in the order of the joints.

    Raises:
        RobotFileError: for the first error in the file; it counts the others and has them all as `errors`.
    """
    try:
        description = RobotDescription.model_validate(document.data)
    except ValidationError as error:
        raise _refusal(document, [_field_error(details) for details in error.errors(include_url=False)]) from None
    errors = list(_tree_errors(description))
    if not errors:
        postures: dict[str, tuple[float, ...]] = {}
        errors += _frame_errors(description)
        errors += _posture_errors(description, postures)
        errors += _bushing_errors(description)
        description = description.model_copy(update={"postures": postures})
    if errors:
        raise _refusal(document, errors)
    return description


def links_in_order(description: RobotDescription) -> list[Link]:
    """The links in the order of the file, but each after its parent.

    Args:
        description: links with unique names, known parents and no cycle.

    Returns:
        Every link once.
    """
    by_name = {link.name: link for link in description.links}
    done: dict[str, Link] = {}
    for link in description.links:
        branch = []
        while link.name not in done:
            branch.append(link)
            if link.parent == "base":
                break
            link = by_name[link.parent]
        done.update((link.name, link) for link in reversed(branch))
    return list(done.values())


def moving_links(description: RobotDescription) -> list[Link]:
    """The links whose joint moves, in order: one value of a posture for each."""
    return [link for link in links_in_order(description) if link.joint.own is not None]


def joint_values(values: object, moving: Sequence[Link]) -> tuple[float, ...]:
    """The values of the joints' own coordinates, from a list of numbers or texts with units.

    Args:
        values: the list.
        moving: the links whose joints it moves, see `moving_links`.

    Raises:
        FieldError: not a list, of another length, or with an entry that is no angle or length.
    """
    if not isinstance(values, list | tuple) or len(values) != len(moving):
        names = listed([f"{link.name}.{link.joint.own}" for link in moving[:13]])
        expected = f"a list of {len(moving)}: {names}" if moving else "an empty list, for no joint moves"
        raise FieldError(values, expected)
    return tuple(
        measured(value, "angle" if link.joint.type == "revolute" else "length", (i,))
        for i, (value, link) in enumerate(zip(values, moving, strict=True))
    )


def did_you_mean(word: str, known: Iterable[str]) -> str | None:
    """A hint that names the nearest known word, if one is near."""
    near = difflib.get_close_matches(word[:60], list(known), n=1, cutoff=0.5)
    return f"Did you mean {near[0]}?" if near else None


def _tree_errors(description: RobotDescription) -> Iterator[FieldError]:
    parents: dict[str, str] = {}
    for i, link in enumerate(description.links):
        if link.name in parents:
            yield _repeated(link.name, "link", ("links", i, "name"))
        parents[link.name] = link.parent
    if len(parents) < len(description.links):
        return
    for i, link in enumerate(description.links):
        if link.parent != "base" and link.parent not in parents:
            yield _unknown(link.parent, "the name of a link, or base", ["base", *parents], ("links", i, "parent"))
    ends = {"base"}
    for i, link in enumerate(description.links):
        chain: dict[str, None] = {}
        name = link.name
        while name in parents and name not in ends and name not in chain:
            chain[name] = None
            name = parents[name]
        if name in chain:
            cycle = [*list(chain)[list(chain).index(name) :], name]
            found = Found(f"a cycle of parents: {listed(cycle, ' -> ')}")
            yield FieldError(found, "parents that lead to base", at=("links", i, "parent"))
        ends.update(chain)


def _frame_errors(description: RobotDescription) -> Iterator[FieldError]:
    links = dict.fromkeys(["base", *(link.name for link in description.links)])
    taken = set(links)
    for i, frame in enumerate(description.frames):
        if frame.name in taken:
            yield _repeated(frame.name, "frame or link", ("frames", i, "name"))
        taken.add(frame.name)
        if frame.link not in links:
            yield _unknown(frame.link, "the name of a link, or base", links, ("frames", i, "link"))


def _posture_errors(description: RobotDescription, read: dict[str, tuple[float, ...]]) -> Iterator[FieldError]:
    moving = moving_links(description)
    for name, values in description.postures.items():
        try:
            read[name] = joint_values(values, moving)
        except FieldError as error:
            error.at = ("postures", name, *error.at)
            yield error


def _bushing_errors(description: RobotDescription) -> Iterator[FieldError]:
    links = (link.name for link in description.links)
    frames = dict.fromkeys(["base", *links, *(frame.name for frame in description.frames)])
    moving = moving_links(description)
    taken = set()
    for i, bushing in enumerate(description.bushings):
        if bushing.name in taken:
            yield _repeated(bushing.name, "bushing", ("bushings", i, "name"))
        taken.add(bushing.name)
        for j, frame in enumerate(bushing.between):
            if frame not in frames:
                at: Location = ("bushings", i, "between", j)
                yield _unknown(frame, "the name of a frame or link, or base", frames, at)
        at = ("bushings", i, "rest")
        if isinstance(bushing.rest, str):
            if bushing.rest not in description.postures:
                postures = description.postures or ["no posture in this file"]
                yield _unknown(bushing.rest, "the name of a posture", postures, at)
        elif bushing.rest is not None:
            try:
                joint_values(bushing.rest, moving)
            except FieldError as error:
                error.at = (*at, *error.at)
                yield error


def _repeated(name: str, what: str, at: Location) -> FieldError:
    return FieldError(Found(f"the name {shown(name)} again"), f"a name no other {what} has", at=at)


def _unknown(name: str, expected: str, known: Iterable[str], at: Location) -> FieldError:
    error = FieldError(name, expected, at=at)
    error.suggest = lambda: did_you_mean(name, known) or f"There is {listed(list(known))}."
    return error


def listed(names: Sequence[str], separator: str = ", ") -> str:
    """Names in a row, at most twelve of them."""
    return separator.join(names if len(names) <= 12 else [*names[:12], "..."])


def _refusal(document: Document, errors: list[FieldError]) -> RobotFileError:
    """The first error in the file, with all of them in its order."""

    def place(error: FieldError) -> int:
        if error.at_key:
            return document.key(error.at).start
        node = document.node(error.at)
        # What is missing is missed at the end, so that a misspelt key is told first.
        return node.end if error.is_missing else node.start

    placed = []
    for i, error in enumerate(sorted(errors, key=place)):
        hint = error.suggest() if error.suggest and i < SUGGESTIONS else error.hint
        where = document.where(error.at, at_key=error.at_key)
        placed.append(RobotFileError(where, found=error.found, expected=error.expected, hint=hint))
    first, others = placed[0], len(placed) - 1
    if not others:
        return first
    count = f"There {'is 1 more error' if others == 1 else f'are {others} more errors'}."
    hint = f"{first.hint} {count}" if first.hint else count
    refusal = RobotFileError(first.where, found=first.found, expected=first.expected, hint=hint)
    refusal.errors = tuple(placed)
    return refusal


def _field_error(details: Mapping[str, Any]) -> FieldError:
    """Pydantic's account of one error, in Armonic's words."""
    at: Location = tuple(details["loc"])
    context = details.get("ctx", {})
    error = context.get("error")
    if isinstance(error, FieldError):
        at_key = bool(at) and at[-1] == "[key]"
        found = FieldError(Found(error.found), error.expected, error.hint, (*at[: -1 if at_key else None], *error.at))
        found.at_key = at_key
        return found
    value, kind = details["input"], details["type"]
    if kind == "extra_forbidden":
        keys = _known_keys(at[:-1])
        hint = did_you_mean(str(at[-1]), keys)
        result = FieldError(Found(f"the unknown key {shown(at[-1])}"), f"one of {', '.join(keys)}", hint, at)
        result.at_key = True
        return result
    if kind == "missing":
        result = FieldError(Found(f"no {at[-1]}"), f"the key {at[-1]}", at=at[:-1])
        result.is_missing = True
        return result
    if kind == "literal_error":
        choices = [word.strip("' ") for word in str(context["expected"]).replace(" or ", ", ").split(",")]
        hint = did_you_mean(value, choices) if isinstance(value, str) else None
        return FieldError(value, f"one of {', '.join(choices)}", hint, at)
    if kind in ("model_type", "dict_type"):
        model = _model_at(at)
        return FieldError(value, model.what if model else "a mapping", at=at)
    if kind == "tuple_type":
        return FieldError(value, "a list", at=at)
    return FieldError(value, str(details["msg"]), at=at)


def _known_keys(at: Location) -> list[str]:
    model = _model_at(at)
    return list(model.model_fields) if model else []


def _model_at(at: Location) -> Any:
    """The schema's class for a location; None if the location holds something else."""
    kind: Any = RobotDescription
    for part in at:
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            field = kind.model_fields.get(str(part))
            kind = field.annotation if field else None
        else:
            # The entries of a list or of a mapping are described by the last argument but `...`.
            arguments = [argument for argument in get_args(kind) if argument is not Ellipsis]
            kind = arguments[-1] if arguments else None
        kind = _unwrapped(kind)
    return kind if isinstance(kind, type) and issubclass(kind, BaseModel) else None


def _unwrapped(kind: Any) -> Any:
    while get_origin(kind) in (Annotated, Union, types.UnionType):
        kind = next(argument for argument in get_args(kind) if argument is not type(None))
    return kind
