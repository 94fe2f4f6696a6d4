"""`armonic export`: the linear model as a MATLAB file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from armonic.cli import arguments
from armonic.cli.arguments import ForceFlag, FrameOption, JsonFlag, PostureOption, RobotName
from armonic.cli.model import EquilibriumOption
from armonic.cli.outputs import check_output
from armonic.cli.terminal import line, print_json
from armonic.cli.tool import ToolMassOption, with_tool_mass

if TYPE_CHECKING:
    from armonic.linear import Equilibrium


def export(
    robot: RobotName,
    output: Annotated[Path, typer.Option("-o", "--output", metavar="FILE", help="Write here: .mat.")],
    posture: PostureOption = None,
    frame: FrameOption = None,
    inputs: Annotated[
        str, typer.Option("--inputs", metavar="AXES", help="Axes of the force (r: of the moment).")
    ] = "xyz",
    outputs: Annotated[
        str, typer.Option("--outputs", metavar="AXES", help="Axes of the displacement among x y z rx ry rz.")
    ] = "xyz",
    equilibrium: EquilibriumOption = "reference",
    tool_mass: ToolMassOption = None,
    force: ForceFlag = False,
    as_json: JsonFlag = False,
) -> None:
    """The linear model as A, B, C, D for MATLAB.

    From forces at a frame, in its axes, and motor torques to displacements of the frame and motor positions.
    """
    how: Equilibrium = arguments.choice("--equilibrium", equilibrium, ("reference", "static"))
    rows, columns = arguments.axes("--outputs", outputs), arguments.axes("--inputs", inputs)
    if output.suffix.lower() != ".mat":
        raise arguments.UsageError("-o", found=str(output), expected="a name that ends in .mat")
    the_robot = with_tool_mass(arguments.open_robot(robot), tool_mass)
    where, label = arguments.posture(the_robot, posture)
    at = arguments.frame(the_robot, frame)
    check_output("-o", output, force=force, sources=[Path(robot)])

    from armonic.linear import linearize

    model = linearize(the_robot, where, equilibrium=how)
    system = model.state_space(frame=at, inputs=columns, outputs=rows)
    system.save_mat(output)
    names = {name: getattr(system, name) for name in ("states", "inputs", "outputs")}
    if as_json:
        print_json({"robot": the_robot.name, "posture": label, "frame": at, "written": str(output), **names})
        return
    size = ", ".join(f"{len(some)} {name}" for name, some in names.items())
    line(f"Wrote {output}: A, B, C, D of {the_robot.name}, posture {label}, frame {at}: {size}.")
