"""What `armonic check` reports: findings about a robot that its file's schema cannot see."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from armonic.description.names import listed
from armonic.robot import Robot

LOW_GEAR_RATIO = 10
"""Below it, rotors that turn with their link change the motion noticeably (Do et al. 2022 assume 100 and more)."""


@dataclass(frozen=True)
class Finding:
    """One remark about a robot.

    Attributes:
        level: "error": results would be wrong or impossible; "warning": worth a look.
        where: dotted path in the robot file, or a posture.
        message: what is the matter, and what to do, in full sentences.
    """

    level: Literal["error", "warning"]
    where: str
    message: str


def check(robot: Robot) -> tuple[Finding, ...]:
    """Check the physics of a robot.

    Args:
        robot: any robot that could be loaded.

    Returns:
        Errors: an inertia tensor that no body can have, a mass matrix that is not positive definite.
        Warnings: principal moments that break the triangle inequality, locked joints, free coordinates that
        nothing holds, motors that nothing holds, low gear ratios, massless links at an end of the tree, damping in
        a URDF, no posture. Empty if there is nothing to say.
    """
    findings = [
        *_inertias(robot),
        *_mass_matrices(robot),
        *_elasticity(robot),
        *_motors(robot),
        *_massless_ends(robot),
        *_left_out(robot),
    ]
    if not robot.postures:
        message = "The file has no posture; add one to name the configurations you work in."
        findings.append(Finding("warning", "postures", message))
    return tuple(findings)


def _inertias(robot: Robot) -> Iterator[Finding]:
    tensors = {f"links.{link.name}.inertia": link.inertia for link in robot.description.links}
    if robot.description.tool is not None:
        tensors["tool.inertia"] = robot.description.tool.inertia
    for where, tensor in tensors.items():
        moments = np.linalg.eigvalsh(np.array(tensor.matrix()))
        found = ", ".join(f"{moment:.4g}" for moment in moments)
        # Rounded tables miss by a last digit; eigvalsh by a few ulp of the largest moment.
        slack = 1e-9 * abs(moments).max()
        if moments[0] < -slack:
            yield Finding(
                "error",
                where,
                f"The principal moments are {found} kg m²; none may be negative. "
                "Check the signs: xy, xz, yz are tensor entries, minus the products of inertia.",
            )
        elif moments[0] + moments[1] < moments[2] - slack:
            yield Finding(
                "warning",
                where,
                f"The principal moments {found} kg m² break the triangle inequality: "
                "each must be at most the sum of the others. No body has this tensor exactly.",
            )


def _mass_matrices(robot: Robot) -> Iterator[Finding]:
    n = len(robot.coordinates)
    if n == 0:
        return
    postures = dict(robot.postures) or {"zero": np.zeros(n)}
    for name, q in postures.items():
        M = np.asarray(robot.mechanism.mass_matrix(q))
        scale = np.sqrt(np.maximum(np.diag(M), 0.0))
        scale[scale == 0.0] = 1.0
        # With a unit diagonal the smallest eigenvalue is a pure number, whatever the coordinates' units.
        values, vectors = np.linalg.eigh(M / scale / scale[:, None])
        if values[0] < n * 1e-13:
            worst = robot.coordinates[int(np.argmax(np.abs(vectors[:, 0])))]
            yield Finding(
                "error",
                f"posture {name}",
                f"The mass matrix is not positive definite: {worst} moves no mass, or the same mass as other "
                "coordinates together. Give its link a mass and an inertia, or drop the coordinate.",
            )


def _elasticity(robot: Robot) -> Iterator[Finding]:
    links = robot.description.links
    if not any(link.elasticity or link.drive for link in links):
        message = "No joint has elasticity or a drive, so every coordinate is locked and nothing vibrates."
        yield Finding("warning", "links", message)
        return
    for link in links:
        own = link.joint.own
        if own is not None and own not in link.elasticity and link.drive is None:
            message = f"The joint has no elasticity about its own axis and no drive: {link.name}.{own} is locked."
            yield Finding("warning", f"links.{link.name}.elasticity", message)
        for key, spring in link.elasticity.items():
            if spring is None and not robot.bushings:
                message = "This coordinate is free, but the file has no bushing that could hold it."
                yield Finding("warning", f"links.{link.name}.elasticity.{key}", message)


def _motors(robot: Robot) -> Iterator[Finding]:
    control = robot.control
    held = (control.kp != 0.0) | (control.ki != 0.0) | (control.link_kp != 0.0) | (control.link_ki != 0.0)
    held |= (control.position != 0.0).any(axis=1)
    loose = [name for name, holds in zip(robot.motors, held, strict=True) if not holds]
    if loose and robot.description.control is None:
        message = (
            "The drives have no control: nothing holds the motors, and they drift. Add `control: {kp: ..., kd: ...}`."
        )
        yield Finding("warning", "control", message)
    elif loose:
        names = listed(loose)
        message = f"No position feedback holds {names}: kp, ki, link_kp and link_ki are zero, and the motor drifts."
        yield Finding("warning", "control.kp", message)
    for link in robot.description.links:
        if link.drive is not None and link.drive.gear_ratio < LOW_GEAR_RATIO:
            message = (
                f"The gear ratio is {link.drive.gear_ratio:g}. The model has the rotor turn about its own axis only, "
                "which is near the truth for high ratios."
            )
            yield Finding("warning", f"links.{link.name}.drive.gear_ratio", message)


def _massless_ends(robot: Robot) -> Iterator[Finding]:
    if robot.urdf is not None:
        return  # URDFs have no other way to say a frame
    tree, parents = robot.tree, {link.parent for link in robot.description.links}
    for link in robot.description.links:
        node = tree.frame_nodes[tree.frames.index(link.name)]
        if tree.masses[node] == 0.0 and link.name not in parents:
            message = "The last link of a branch has no mass; a frame does the same without a joint."
            yield Finding("warning", f"links.{link.name}.mass", message)


def _left_out(robot: Robot) -> Iterator[Finding]:
    for joint in robot.urdf.damped if robot.urdf is not None else ():
        message = "The damping that the URDF gives this joint is not used; give the joint an `elasticity` with damping."
        yield Finding("warning", f"joint {joint}", message)
