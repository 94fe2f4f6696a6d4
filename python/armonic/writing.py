"""Files written whole or not at all."""

from __future__ import annotations

import os
import secrets
import shutil
from contextlib import suppress
from pathlib import Path

from armonic.errors import DataFileError


def write_whole(path: str | Path, data: bytes) -> None:
    """Writes beside the place and renames, so that nobody ever finds half a file; what was there keeps its permissions.

    A symbolic link stays one; what it points to is replaced. Devices and pipes are left alone.

    Raises:
        DataFileError: the place is no regular file, or it cannot be written.
    """
    draft = None
    try:
        target = Path(path).resolve()
        if target.is_dir():
            raise DataFileError(str(path), found="a directory", expected="the path of a file to write")
        if target.exists() and not target.is_file():
            raise DataFileError(str(path), found="a device or a pipe", expected="the path of a file to write")
        draft = target.with_name(f".{target.name[:80]}.{secrets.token_hex(4)}.tmp")
        with draft.open("xb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        if target.exists():
            shutil.copymode(target, draft)
        draft.replace(target)
    except DataFileError:
        raise
    except (OSError, RuntimeError, ValueError) as error:  # loops of links and impossible names among them
        found = f"a place that cannot be written ({getattr(error, 'strerror', None) or error})"
        raise DataFileError(str(path), found=found, expected="a folder that exists and a writable file") from error
    finally:
        if draft is not None:
            with suppress(OSError):
                draft.unlink()  # left over only if something failed
