"""Robots that ship with Armonic, as the robot files they are."""

from __future__ import annotations

from importlib.resources import files

_SUFFIX = ".yaml"


def names() -> tuple[str, ...]:
    """The names of the catalog's robots, sorted."""
    entries = (entry.name for entry in files(__name__).iterdir())
    return tuple(sorted(name.removesuffix(_SUFFIX) for name in entries if name.endswith(_SUFFIX)))


def read(name: str) -> str:
    """The text of a robot file of the catalog.

    Args:
        name: one of `names()`.

    Raises:
        KeyError: there is no such robot.
    """
    if name not in names():
        raise KeyError(name)
    return files(__name__).joinpath(f"{name}{_SUFFIX}").read_text(encoding="utf-8")
