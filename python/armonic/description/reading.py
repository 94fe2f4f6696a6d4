"""From a YAML document to a checked description: every error is placed by file, line and dotted path."""

from __future__ import annotations

import types
from collections.abc import Mapping
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError

from armonic.description.document import Document, Location
from armonic.description.fields import FieldError, Found
from armonic.description.names import check_names, did_you_mean, listed
from armonic.description.schema import RobotDescription
from armonic.description.units import shown
from armonic.errors import RobotFileError

__all__ = ["SUGGESTIONS", "did_you_mean", "listed", "read_description", "refusal"]

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
        raise refusal(document, [_field_error(details) for details in error.errors(include_url=False)]) from None
    description, errors = check_names(description)
    if errors:
        raise refusal(document, errors)
    return description


def refusal(document: Document, errors: list[FieldError]) -> RobotFileError:
    """The first error in the file, with all of them in its order.

    Args:
        document: the text, for the places.
        errors: at least one.
    """

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
    return in_one(placed)


def in_one(placed: list[RobotFileError]) -> RobotFileError:
    """The first of several errors, which counts the others and has them all as `errors`."""
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
