"""The command `armonic`: a thin shell over the library, one module per concern.

application.py the commands together; refusals.py errors in one line; arguments.py words typed into values;
terminal.py tables, JSON and the progress bar; outputs.py files that must not be replaced; results.py a fit in
tables; measured.py and problem.py what a fit reads and what it is told; delivery.py a fit written and shown;
motions.py, amounts.py and setting.py what a run is told; run_results.py, run_delivery.py and oma_results.py what comes
of it; model.py, fitting.py, planning.py, mapping.py, simulating.py, identifying.py, export.py, robots.py, demo.py the
commands, sections.py their help. What is slow to import is imported by the command that needs it.
"""

from __future__ import annotations

from collections.abc import Sequence

INTERRUPTED = 130
"""Exit code after Ctrl-C."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        arguments: the words after `armonic`; those of the process by default.

    Returns:
        The exit code: 0, 2 on bad input (with one line on stderr), 130 on Ctrl-C.
    """
    try:
        from armonic.cli.application import run  # in here, so that Ctrl-C may come while this is imported

        return run(arguments)
    except KeyboardInterrupt:
        return INTERRUPTED
