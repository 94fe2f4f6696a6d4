"""`armonic modes` and `armonic frf`: what a robot file predicts."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from armonic.cli import arguments
from armonic.cli.arguments import ForceFlag, FrameOption, JsonFlag, PostureOption, RobotName, UsageError
from armonic.cli.outputs import check_output
from armonic.cli.terminal import heading, line, print_json, show, table
from armonic.cli.tool import ToolMassOption, with_tool_mass
from armonic.text import count, format_hz, format_si, frf_unit

if TYPE_CHECKING:
    from rich.table import Table

    from armonic.linear import Equilibrium
    from armonic.loads import WrenchAxes
    from armonic.modal import Modes
    from armonic.response import Frf
    from armonic.stability import GainMargin

WrenchOption = Annotated[
    str | None,
    typer.Option(
        "--wrench",
        metavar="FX,FY,FZ,MX,MY,MZ",
        help="Constant load at the frame, N and N m.",
    ),
]
WrenchAxesOption = Annotated[
    str,
    typer.Option(
        "--wrench-axes",
        metavar="world|frame",
        help="Whether the load keeps its direction in the world or turns with the frame.",
    ),
]
EquilibriumOption = Annotated[
    str,
    typer.Option(
        "--equilibrium",
        metavar="reference|static",
        help="Linearize at the posture itself, or where gravity and load settle it.",
    ),
]

STABILITY = {
    "asymptotically stable": ("Asymptotically stable: every motion dies out.", "green"),
    "marginal": ("Marginally stable: some motion neither grows nor dies out.", "yellow"),
    "unstable": ("Unstable: some motion grows.", "red"),
}
PEAKS = 3
LINES = "0.2:30:0.2"
ROUNDING = 1e-12
"""A response that is never more than this share of the largest is what rounding left of zero."""


def modes(
    robot: RobotName,
    posture: PostureOption = None,
    wrench: WrenchOption = None,
    frame: FrameOption = None,
    wrench_axes: WrenchAxesOption = "world",
    equilibrium: EquilibriumOption = "reference",
    tool_mass: ToolMassOption = None,
    as_json: JsonFlag = False,
) -> None:
    """Natural frequencies, damping and what moves.

    With drives: of the closed loop, and how far the gains of each are from making it unstable.
    """
    how: Equilibrium = arguments.choice("--equilibrium", equilibrium, ("reference", "static"))
    axes: WrenchAxes = arguments.choice("--wrench-axes", wrench_axes, ("world", "frame"))
    load = None if wrench is None else arguments.wrench(wrench)
    if load is None and frame is not None:
        raise UsageError(
            "--frame", found=f"{frame!r} without a wrench", expected="both --wrench and --frame, or neither"
        )
    the_robot = with_tool_mass(arguments.open_robot(robot), tool_mass)
    where, label = arguments.posture(the_robot, posture)
    at = None if load is None else arguments.frame(the_robot, frame)

    from armonic.linear import linearize
    from armonic.modal import modes as compute
    from armonic.stability import gain_margins

    model = linearize(the_robot, where, wrench=load, frame=at, wrench_axes=axes, equilibrium=how)
    result, margins = compute(model), gain_margins(model)
    if as_json:
        from armonic.cli.results import modes_data

        print_json(
            {
                "robot": the_robot.name,
                "posture": label,
                "equilibrium": how,
                "wrench": load,
                "wrench_axes": axes if load else None,
                "frame": at,
                "tool_mass": None if the_robot.description.tool is None else the_robot.description.tool.mass,
                "stability": result.stability,
                "gain_margins": [vars(margin) for margin in margins],
                "coordinates": list(result.coordinates),
                "modes": modes_data(result),
            }
        )
        return
    from rich.text import Text

    context = f"{the_robot.name}, posture {label}"
    if tool_mass is not None and the_robot.description.tool is not None:
        context += f", tool of {the_robot.description.tool.mass:g} kg"
    if load is not None:
        context += f", under a load at {at}" + (" that turns with it" if axes == "frame" else "")
    if how == "static":
        context += ", at static equilibrium"
    verdict, style = STABILITY[result.stability]
    show(heading(context), "", _modes_table(result), "", Text(verdict, style=style))
    for grid in _margins(margins):
        show("", grid)


def _margins(margins: Sequence[GainMargin]) -> Iterator[Table]:
    """A table of how far the gains of each drive are from making the loop unstable; none if it is, or has no drives."""
    if not margins or any(math.isnan(margin.upper) for margin in margins):
        return
    grid = table("stable while\nall gains of", ">times\nfrom", ">\nto", ">then grows\nHz")
    for margin in margins:
        ends = (format_si(end, digits=3) for end in (margin.lower, margin.upper))
        grid.add_row(margin.motor, *ends, "–" if math.isnan(margin.freq_hz) else format_hz(margin.freq_hz))
    yield grid


def _modes_table(result: Modes) -> Table:
    grid = table(">", ">natural\nHz", ">damped\nHz", ">damping\n%", "what moves\n(share of the elastic energy)")
    for i in range(len(result)):
        damped = format_hz(float(result.damped_freq_hz[i])) if result.oscillatory[i] else "none"
        movers = ", ".join(f"{name} {100 * share:.0f} %" for name, share in result.movers(i))
        grid.add_row(
            str(i + 1),
            format_hz(float(result.natural_freq_hz[i])),
            damped,
            f"{100 * result.damping_ratio[i]:.2f}",
            movers or ("rigid body" if result.poles[i] == 0 else "–"),
        )
    return grid


def frf(
    robot: RobotName,
    posture: PostureOption = None,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="FILE", help="Write here: .uff, .unv, .uf58 or .csv."),
    ] = None,
    frame: FrameOption = None,
    freq: Annotated[
        str,
        typer.Option("--freq", metavar="START:STOP:STEP", help="Frequency lines in Hz, both ends included."),
    ] = LINES,
    kind: Annotated[
        str, typer.Option("--kind", metavar="KIND", help="receptance, mobility or accelerance.")
    ] = "accelerance",
    outputs: Annotated[
        str, typer.Option("--outputs", metavar="AXES", help="Axes of the response among x y z rx ry rz.")
    ] = "xyz",
    inputs: Annotated[
        str, typer.Option("--inputs", metavar="AXES", help="Axes of the force (r: of the moment).")
    ] = "xyz",
    binary: Annotated[bool, typer.Option("--binary", help="Write a binary universal file (58b).")] = False,
    force: ForceFlag = False,
    as_json: JsonFlag = False,
) -> None:
    """Frequency responses at a frame: to a file, or their peaks.

    In the axes of the frame; without -o a summary of the peaks is printed.
    """
    lines = arguments.lines(freq)
    rows, columns = arguments.axes("--outputs", outputs), arguments.axes("--inputs", inputs)
    is_csv = output is not None and output.suffix.lower() == ".csv"
    if binary and (output is None or is_csv):
        raise UsageError("--binary", found=f"-o {output}" if is_csv else "no -o", expected="a universal file to write")
    the_robot = arguments.open_robot(robot)
    where, label = arguments.posture(the_robot, posture)
    at = arguments.frame(the_robot, frame)

    from armonic.response import KINDS
    from armonic.synthesis import frf as compute

    what = arguments.choice("--kind", kind, KINDS)
    if output is not None:
        check_output("-o", output, force=force, sources=[Path(robot)])
    response = compute(the_robot, where, lines, frame=at, kind=what, outputs=rows, inputs=columns)
    if output is not None:
        from armonic.files import write_frf

        write_frf(output, response, **({} if is_csv else {"name": the_robot.name, "binary": binary}))
    if as_json:
        print_json(_frf_data(the_robot.name, label, response, output))
        return
    if output is not None:
        n = f"{len(rows)} x {len(columns)} {what} at {at}, posture {label}"
        line(f"Wrote {output}: {n}, {lines.size} lines from {lines[0]:g} to {lines[-1]:g} Hz.")
    else:
        context = f"{the_robot.name}, posture {label}: {what} at {at}"
        show(
            heading(context),
            f"in {_units(response)}",
            "",
            _peak_table(response) if lines.size > 1 else _value_table(response),
            "",
            "Write the responses to a file with -o FILE.uff or .csv.",
        )
    if freq == LINES:
        from armonic.modal import modes as compute_modes

        show(*_modes_above(compute_modes(the_robot, where), float(lines[-1])))


def _modes_above(result: Modes, last_hz: float) -> Iterator[str]:
    """A line on the modes that the default frequencies leave out, and on frequencies that show them."""
    above = result.damped_freq_hz[result.oscillatory & (result.damped_freq_hz > last_hz)]
    if not above.size:
        return
    # A step of 1, 2 or 5 times a power of ten, about 300 of them to a tenth above the highest mode.
    wanted = 1.1 * float(above.max()) / 300
    decade = 10.0 ** math.floor(math.log10(wanted))
    step = next(k * decade for k in (1, 2, 5, 10) if k * decade >= wanted)
    stop = 50 * step * math.ceil(300 * wanted / (50 * step))
    verb, them = ("lies", "it") if above.size == 1 else ("lie", "them")
    modes = f"{above.size} of {count(len(result), 'mode')}"
    yield f"{modes} {verb} above {last_hz:g} Hz: see {them} with --freq {step:g}:{stop:g}:{step:g}"


def _is_zero(response: Frf, row: int, column: int) -> bool:
    """Whether a response is zero but for rounding, as across the plane of a planar robot."""
    size = response.magnitude
    return bool(size[:, row, column].max() <= ROUNDING * size.max())


def _peaks(response: Frf, row: int, column: int) -> list[tuple[float, float]]:
    """Frequency (Hz) and magnitude of the highest local maxima, highest first; none of a response that is zero."""
    if _is_zero(response, row, column):
        return []
    size = response.magnitude[:, row, column]
    inner = (size[1:-1] > size[:-2]) & (size[1:-1] >= size[2:])
    peaks = sorted(inner.nonzero()[0] + 1, key=lambda line: -size[line])[:PEAKS]
    return [(float(response.freq_hz[line]), float(size[line])) for line in peaks]


def _cells(response: Frf) -> Iterator[tuple[str, str, int, int]]:
    for row, output in enumerate(response.outputs):
        for column, force in enumerate(response.inputs):
            yield output, force, row, column


def _peak_table(response: Frf) -> Table:
    grid = table("", *(f">{order} peak" for order in ("highest", "second", "third")))
    for output, force, row, column in _cells(response):
        found = [f"{format_si(size, digits=3)} at {hz:g} Hz" for hz, size in _peaks(response, row, column)]
        grid.add_row(f"{output}/{force}", *found, *["–"] * (PEAKS - len(found)))
    return grid


def _value_table(response: Frf) -> Table:
    grid = table("", f">at {response.freq_hz[0]:g} Hz", ">phase")
    for output, force, row, column in _cells(response):
        size, phase = (part[0, row, column] for part in (response.magnitude, response.phase_rad))
        found = (format_si(size, digits=3), f"{math.degrees(phase):.1f}°")
        grid.add_row(f"{output}/{force}", *(("–", "–") if _is_zero(response, row, column) else found))
    return grid


def _units(response: Frf) -> str:
    """The unit of every entry, or which of several they have."""
    units = {frf_unit(response.kind, output, force): f"{output}/{force}" for output, force, *_ in _cells(response)}
    return next(iter(units)) if len(units) == 1 else ", ".join(f"{unit} as {cell}" for unit, cell in units.items())


def _frf_data(name: str, posture: str, response: Frf, output: Path | None) -> dict[str, Any]:
    data: dict[str, Any] = {
        "robot": name,
        "posture": posture,
        "frame": response.frame,
        "kind": response.kind,
        "outputs": list(response.outputs),
        "inputs": list(response.inputs),
        "peaks": [
            {"output": output, "input": force, "freq_hz": hz, "magnitude": size}
            for output, force, row, column in _cells(response)
            for hz, size in _peaks(response, row, column)
        ],
    }
    if output is not None:
        return data | {"lines": response.freq_hz.size, "written": str(output)}
    return data | {"freq_hz": response.freq_hz, "re": response.values.real, "im": response.values.imag}
