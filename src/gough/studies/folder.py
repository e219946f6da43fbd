"""Writing a report so that its folder never holds half of one."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Mapping
from pathlib import Path

from gough.errors import GoughError


class StudyError(GoughError, OSError):
    """A report can not be written where it was asked for."""


class Folder:
    """The folder of one report.

    Files are first written to a hidden folder inside it and then renamed, the page last.

    Raises:
        StudyError: the path is a file, or nothing can be written there.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._made = not path.exists()
        try:
            path.mkdir(parents=True, exist_ok=True)
            self._desk = Path(tempfile.mkdtemp(prefix=".writing-", dir=path))
        except FileExistsError:
            raise StudyError(f"{path} is a file; a study is written to a folder") from None
        except OSError as error:
            raise _refusal(path, error) from None

    def __enter__(self) -> Folder:
        return self

    def __exit__(self, *_: object) -> None:
        shutil.rmtree(self._desk, ignore_errors=True)
        if self._made and not any(self.path.iterdir()):
            self.path.rmdir()

    def write(self, files: Mapping[str, bytes]) -> None:
        """Write files under their names relative to the folder, in order.

        Raises:
            StudyError: a file can not be written; those renamed before it stay.
        """
        try:
            for name, content in files.items():
                draft = self._desk / name
                draft.parent.mkdir(parents=True, exist_ok=True)
                draft.write_bytes(content)
            for name in files:
                (self.path / name).parent.mkdir(parents=True, exist_ok=True)
                os.replace(self._desk / name, self.path / name)
        except OSError as error:
            raise _refusal(self.path, error) from None


def _refusal(path: Path, error: OSError) -> StudyError:
    reason = error.strerror or str(error)
    return StudyError(f"can not write a study to {path}: {reason}; name another folder")
