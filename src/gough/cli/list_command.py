"""``gough list``."""

from __future__ import annotations

from typing import Any

import click

from gough.cli.common import json_option, print_json, reporting_errors


@click.command("list")
@json_option
@reporting_errors
def command(as_json: bool) -> None:
    """The robots of the catalogue: legs, mobility, loops, redundant equations."""
    from gough.catalogue import facts

    rows = facts()
    if as_json:
        print_json({"robots": rows})
        return
    click.echo(_table(rows))
    for row in rows:
        if row["variants"]:
            click.echo(f"\n{row['name']} --variant {' | '.join(row['variants'])}")
    click.echo("\nActuated joints in brackets. `gough analyse NAME` tells more.")


def _table(rows: list[dict[str, Any]]) -> str:
    heads = ("name", "legs", "mobility", "loops", "redundant equations")
    cells = [heads] + [tuple(str(row[key]) for key in KEYS) for row in rows]
    widths = [max(len(line[k]) for line in cells) for k in range(len(heads))]
    return "\n".join(
        "  ".join(
            text.ljust(width) if k < 2 else text.rjust(width)
            for k, (text, width) in enumerate(zip(line, widths, strict=True))
        ).rstrip()
        for line in cells
    )


KEYS = ("name", "architecture", "mobility", "loops", "redundant_equations")
