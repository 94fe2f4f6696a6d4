"""The command line as a fixture, for every file that runs it."""

from __future__ import annotations

from pathlib import Path

import pytest

from armonic import cli
from command_line import WIDTH, Armonic, Run


@pytest.fixture
def armonic(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Armonic:
    """The command, on a terminal of 80 columns."""
    monkeypatch.setenv("COLUMNS", str(WIDTH))

    def run(*words: str | Path) -> Run:
        code = cli.main([str(word) for word in words])
        return Run(code, *capsys.readouterr())

    return run


@pytest.fixture
def empty_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """An empty folder that the test runs in."""
    monkeypatch.chdir(tmp_path)
    return tmp_path
