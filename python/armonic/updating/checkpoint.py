"""The state of a run in a file, so that a long run can go on where it was ended."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import armonic
from armonic.errors import UpdateError
from armonic.writing import write_whole

FORMAT = 1
"""Version of the layout of the file."""
MARK = "armonic_checkpoint"
"""First key of the file; its value is the format."""
HINT = "Delete it, or give another name."


class Checkpoint:
    """A JSON file with the state of one run; whoever finds it finds it whole.

    It holds the format, Armonic's version, the fingerprint of the problem, and the state with its own digest. A file
    that is no checkpoint of this problem is refused, never overwritten.

    Args:
        path: the file.
        problem: fingerprint of the problem and of what the run depends on (`Record.fingerprint`).
    """

    def __init__(self, path: str | Path, problem: str) -> None:
        self.path, self.problem = Path(path), problem
        self._written: tuple[int, ...] | None = None

    def load(self) -> dict[str, Any] | None:
        """The state in the file; None if there is no file.

        Raises:
            UpdateError: the file cannot be read, is no checkpoint, is damaged, has another format or belongs to
                another problem; or its folder does not exist.
        """
        try:
            text = self.path.read_bytes()
        except FileNotFoundError:
            self._refuse_without_folder()
            return None
        except (OSError, ValueError) as error:  # impossible names among them
            raise self._refusal(
                f"a place that cannot be read ({getattr(error, 'strerror', None) or error})", "a file", None
            ) from error
        state = self._state(self._content(text))
        self._written = self._identity()
        return state

    def save(self, state: dict[str, Any]) -> None:
        """Writes the state, whole or not at all.

        Raises:
            UpdateError: the file is there and is no checkpoint of this problem.
            DataFileError: it cannot be written.
        """
        if self._written is None or self._identity() != self._written:
            self.load()
        text = json.dumps(state, allow_nan=False)
        head = {MARK: FORMAT, "armonic": armonic.__version__, "problem": self.problem, "state_sha256": _sha256(text)}
        write_whole(self.path, f'{json.dumps(head)[:-1]}, "state": {text}}}\n'.encode())
        self._written = self._identity()

    def remove(self) -> None:
        """Deletes the file, if there is one.

        Raises:
            UpdateError: it is no checkpoint of this problem, or cannot be deleted.
        """
        if self.load() is None:
            return
        try:
            self.path.unlink(missing_ok=True)
        except OSError as error:
            raise self._refusal(
                f"a file that cannot be deleted ({error.strerror})", "a folder that can be written", None
            ) from error
        self._written = None

    def _content(self, text: bytes) -> dict[str, Any]:
        try:
            content = json.loads(text)
        except (ValueError, RecursionError) as error:
            found = "a damaged checkpoint" if text.lstrip().startswith(f'{{"{MARK}"'.encode()) else "no JSON"
            raise self._refusal(found, "a checkpoint") from error
        if not isinstance(content, dict) or MARK not in content:
            raise self._refusal("a file of another kind", "a checkpoint")
        return content

    def _state(self, content: dict[str, Any]) -> dict[str, Any]:
        if content[MARK] != FORMAT or isinstance(content[MARK], bool):
            version = str(content.get("armonic"))[:20]
            raise self._refusal(
                f"a checkpoint of format {str(content[MARK])[:20]}, from Armonic {version}", f"format {FORMAT}"
            )
        state = content.get("state")
        if not isinstance(state, dict) or content.get("state_sha256") != _sha256(json.dumps(state)):
            raise self._refusal("a damaged checkpoint", "one that is as it was written")
        if content.get("problem") != self.problem:
            raise self._refusal(
                "a checkpoint of another problem: robot, measurements, parameters, bounds, options or seed differ",
                "one of this problem",
            )
        return state

    def _refuse_without_folder(self) -> None:
        """Said before the run, not when the first state is to be written."""
        if not self.path.parent.is_dir():
            raise self._refusal("no such folder", "a folder that exists", None)

    def _refusal(self, found: str, expected: str, hint: str | None = HINT) -> UpdateError:
        return UpdateError(f"checkpoint {self.path}", found=found, expected=expected, hint=hint)

    def _identity(self) -> tuple[int, ...] | None:
        """Changes when anyone writes the file, so that it is read again before it is replaced."""
        try:
            found = self.path.stat()
        except OSError:
            return None
        return found.st_dev, found.st_ino, found.st_size, found.st_mtime_ns


def _sha256(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
