"""The names in a robot file checked against each other: parents, frames, postures, motors."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Iterator, Sequence

from armonic.description.actuation import GAINS, ControlEntry
from armonic.description.document import Location
from armonic.description.fields import FieldError, Found, measured
from armonic.description.schema import Link, RobotDescription
from armonic.description.units import Dimension, shown


def check_names(description: RobotDescription) -> tuple[RobotDescription, list[FieldError]]:
    """Check the names of a description against each other.

    Args:
        description: entries that are right by themselves.

    Returns:
        The description, with numbers where only the joints say what is measured (postures, waypoints, state feedback);
        and every error.
    """
    errors = list(_tree_errors(description))
    if errors:
        return description, errors
    moving = moving_links(description)
    read: dict[str, object] = {}
    postures: dict[str, tuple[float, ...]] = {}
    errors += _frame_errors(description)
    errors += _posture_errors(description, moving, postures)
    errors += _bushing_errors(description, moving)
    read["postures"] = postures
    for checks in (_path_errors, _control_errors):
        errors += checks(description, moving, read)
    return description.model_copy(update=read), errors


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


def motor_names(links: Iterable[Link]) -> list[str]:
    """The motors of the links that have a drive: "link.motor"."""
    return [f"{link.name}.motor" for link in links if link.drive is not None]


def feedback_dimension(name: str, driven: Sequence[Link], column: int) -> Dimension:
    """What an entry of state feedback measures: a motor's torque for an angle, or for a displacement of a slide."""
    slides = column < len(driven) and driven[column].joint.type == "prismatic"
    if name == "position":
        return "coupling stiffness" if slides else "rotational stiffness"
    return "coupling damping" if slides else "rotational damping"


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


def listed(names: Sequence[str], separator: str = ", ") -> str:
    """Names in a row, at most twelve of them."""
    return separator.join(names if len(names) <= 12 else [*names[:12], "..."])


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
    if description.tool is None:
        return
    at: Location = ("tool", "frame")
    carriers = {**dict.fromkeys(links), **{frame.name: frame.link for frame in description.frames}}
    if description.tool.frame not in carriers:
        known = [name for name in carriers if name != "base"]
        yield _unknown(description.tool.frame, "the name of a frame or link", known, at)
    elif "base" in (description.tool.frame, carriers[description.tool.frame]):
        found = Found(f"{shown(description.tool.frame)}, which does not move")
        yield FieldError(found, "a link, or a frame on a link", at=at)


def _posture_errors(
    description: RobotDescription, moving: Sequence[Link], read: dict[str, tuple[float, ...]]
) -> Iterator[FieldError]:
    for name, values in description.postures.items():
        try:
            read[name] = joint_values(values, moving)
        except FieldError as error:
            error.at = ("postures", name, *error.at)
            yield error


def _path_errors(
    description: RobotDescription, moving: Sequence[Link], read: dict[str, object]
) -> Iterator[FieldError]:
    paths = {}
    for name, path in description.paths.items():
        through: list[object] = []
        for i, waypoint in enumerate(path.through):
            at: Location = ("paths", name, "through", i)
            if isinstance(waypoint, str):
                through.append(waypoint)
                if waypoint not in description.postures:
                    yield _unknown_posture(waypoint, description, at)
                continue
            try:
                through.append(joint_values(waypoint, moving))
            except FieldError as error:
                error.at = (*at, *error.at)
                yield error
        paths[name] = path.model_copy(update={"through": tuple(through)})
    read["paths"] = paths


def _control_errors(
    description: RobotDescription, moving: Sequence[Link], read: dict[str, object]
) -> Iterator[FieldError]:
    control, driven = description.control, [link for link in moving if link.drive is not None]
    if control is None:
        return
    if not driven:
        found, hint = Found("control without drives"), "Give a link a `drive`, or remove `control`."
        error = FieldError(found, "a link with a drive", hint, ("control",))
        error.at_key = True
        yield error
        return
    motors = motor_names(driven)
    for name in GAINS:
        gain = getattr(control, name)
        if isinstance(gain, tuple) and len(gain) != len(motors):
            expected = f"one number, or a list of {len(motors)}: {listed(motors)}"
            yield FieldError(gain, expected, at=("control", name))
    try:
        read["control"] = _measured_feedback(control, driven)
    except FieldError as error:
        yield error


def _measured_feedback(control: ControlEntry, driven: Sequence[Link]) -> ControlEntry:
    """The control with its feedback matrices as numbers."""
    columns = [*(f"{link.name}.{link.joint.own}" for link in driven), *motor_names(driven)]
    count = len(driven)
    matrices: dict[str, tuple[tuple[float, ...], ...]] = {}
    for name in control.state_feedback.given:
        at: Location = ("control", "state_feedback", name)
        rows = getattr(control.state_feedback, name)
        if len(rows) != count:
            raise FieldError(rows, f"a list of {count} rows: {listed(motor_names(driven))}", at=at)
        for i, row in enumerate(rows):
            if len(row) != 2 * count:
                raise FieldError(row, f"a row of {2 * count}: {listed(columns)}", at=(*at, i))
        matrices[name] = tuple(
            tuple(measured(v, feedback_dimension(name, driven, j), (*at, i, j)) for j, v in enumerate(row))
            for i, row in enumerate(rows)
        )
    return control.model_copy(update={"state_feedback": control.state_feedback.model_copy(update=matrices)})


def _bushing_errors(description: RobotDescription, moving: Sequence[Link]) -> Iterator[FieldError]:
    links = (link.name for link in description.links)
    frames = dict.fromkeys(["base", *links, *(frame.name for frame in description.frames)])
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
                yield _unknown_posture(bushing.rest, description, at)
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


def _unknown_posture(name: str, description: RobotDescription, at: Location) -> FieldError:
    return _unknown(name, "the name of a posture", description.postures or ["no posture in this file"], at)
