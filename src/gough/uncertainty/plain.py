"""Numbers as data and as text."""

from __future__ import annotations

from typing import Any

import numpy as np


def plain(values: Any) -> Any:
    """Nested lists with None for what is no finite number."""
    values = np.asarray(values)
    if values.ndim:
        return [plain(value) for value in values]
    if values.dtype.kind in "iu":
        return int(values)
    return float(values) if np.isfinite(values) else None


def number(value: float) -> str:
    """The shortest text that reads back as the same float."""
    return repr(float(value)).removesuffix(".0")


def short(value: float, digits: int = 4) -> str:
    """A number of a table; - for what is none."""
    return f"{value:.{digits}g}" if np.isfinite(value) else "-"


def share(value: float) -> str:
    """A part of a whole in percent, with two digits that count."""
    if value < 0.1 or value == 1:
        return f"{100 * value:.2g} %" if value < 1 else "100 %"
    return f"{100 * value:.1f} %" if value < 0.999 else f"{100 * value:.6g} %"


def percent(value: float) -> str:
    """A level or a confidence in percent, with all its digits."""
    return f"{100 * value:.12g} %"


def count(many: int, what: str) -> str:
    """1 run, 2 runs."""
    return f"{many} {what}" if many == 1 else f"{many} {what}s"


def table(rows: list[list[str]], indent: str = "  ") -> list[str]:
    """Lines of columns: the first to the left, the others to the right."""
    widths = [max(len(cell) for cell in column) for column in zip(*rows, strict=True)]
    return [
        (indent + row[0].ljust(widths[0]) + "".join(
            "  " + cell.rjust(width) for cell, width in zip(row[1:], widths[1:], strict=True)
        )).rstrip()
        for row in rows
    ]  # fmt: skip
