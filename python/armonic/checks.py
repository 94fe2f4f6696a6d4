"""What `armonic check` reports: findings about a robot that its file's schema cannot see."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from armonic.robot import Robot


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
        nothing holds, massless links at an end of the tree, no posture. Empty if there is nothing to say.
    """
    findings = [
        *_inertias(robot),
        *_mass_matrices(robot),
        *_elasticity(robot),
        *_massless_ends(robot),
    ]
    if not robot.postures:
        message = "The file has no posture; add one to name the configurations you work in."
        findings.append(Finding("warning", "postures", message))
    return tuple(findings)


def _inertias(robot: Robot) -> Iterator[Finding]:
    for link in robot.description.links:
        where = f"links.{link.name}.inertia"
        moments = np.linalg.eigvalsh(np.array(link.inertia.matrix()))
        listed = ", ".join(f"{moment:.4g}" for moment in moments)
        # Rounded tables miss by a last digit; eigvalsh by a few ulp of the largest moment.
        slack = 1e-9 * abs(moments).max()
        if moments[0] < -slack:
            yield Finding(
                "error",
                where,
                f"The principal moments are {listed} kg m²; none may be negative. "
                "Check the signs: xy, xz, yz are tensor entries, minus the products of inertia.",
            )
        elif moments[0] + moments[1] < moments[2] - slack:
            yield Finding(
                "warning",
                where,
                f"The principal moments {listed} kg m² break the triangle inequality: "
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
    if not any(link.elasticity for link in links):
        message = "No joint has elasticity, so every coordinate is locked and nothing vibrates."
        yield Finding("warning", "links", message)
        return
    for link in links:
        own = link.joint.own
        if own is not None and own not in link.elasticity:
            message = f"The joint has no elasticity about its own axis: {link.name}.{own} is locked."
            yield Finding("warning", f"links.{link.name}.elasticity", message)
        for key, spring in link.elasticity.items():
            if spring is None and not robot.bushings:
                message = "This coordinate is free, but the file has no bushing that could hold it."
                yield Finding("warning", f"links.{link.name}.elasticity.{key}", message)


def _massless_ends(robot: Robot) -> Iterator[Finding]:
    parents = {link.parent for link in robot.description.links}
    for link in robot.description.links:
        if link.mass == 0.0 and link.name not in parents:
            message = "The last link of a branch has no mass; a frame does the same without a joint."
            yield Finding("warning", f"links.{link.name}.mass", message)
