"""Numbers as people read them."""

from __future__ import annotations

NOISE = 1e-12
"""What is smaller, of lengths and angles, is shown as zero."""
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def written(value: float, digits: int = 6) -> str:
    """A number with so many digits, with a true minus sign and raised powers of ten."""
    plain = f"{value + 0.0:.{digits}g}"
    if "e" not in plain:
        return plain.replace("-", "\N{MINUS SIGN}")
    front, power = plain.split("e")
    raised = str(int(power)).translate(RAISED)
    front = front.replace("-", "\N{MINUS SIGN}")
    return f"10{raised}" if front == "1" else f"{front}\N{THIN SPACE}×\N{THIN SPACE}10{raised}"
