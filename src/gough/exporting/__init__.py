"""Folders of source code: every model of a robot, a program that tests them, and their README."""

from gough.exporting.folder import files
from gough.exporting.models import Exported, exported_models

__all__ = ["Exported", "exported_models", "files"]
