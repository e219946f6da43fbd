"""``gough check``."""

from __future__ import annotations

from typing import Any

import click

from gough.cli.common import json_option, parsed, print_json, reporting_errors, robot_argument


def _print_schema(ctx: click.Context, _: click.Parameter, wanted: bool) -> None:
    """Print the JSON schema of descriptions and leave, before ROBOT is asked for."""
    if not wanted or ctx.resilient_parsing:
        return
    from gough.description import Mechanism

    schema = Mechanism.model_json_schema()
    print_json({"$schema": "https://json-schema.org/draft/2020-12/schema", **schema})
    ctx.exit()


@click.command("check")
@robot_argument
@json_option
@click.option(
    "--schema",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_print_schema,
    help="Print the JSON schema of descriptions, for editors.",
)
@reporting_errors
def command(
    robot: str, settings: tuple[str, ...], variants: tuple[str, ...], modelling: Any, as_json: bool
) -> None:
    """Check the description ROBOT, each of its variants, and whether its loops close.

    All errors of the file are printed at once, each with file:line:column.
    """
    from gough.robot import load, open_source

    loaded = load(robot, modelling, variants, **parsed(settings))
    source, known = open_source(robot), loaded.mechanism.variants
    for name in known:
        source.mechanism(variants=(name,))
    structure, assembly = loaded.structure, loaded.home.assembly
    if as_json:
        facts = {
            "name": loaded.name,
            "architecture": structure.architecture,
            "loops": structure.loops,
            "cut": [closing.name for closing in structure.closings],
            "assembly": {
                "residual": assembly.residual,
                "steps": assembly.steps,
                "moved": list(assembly.moved),
            },
            "variants": {name: variant.about for name, variant in known.items()},
        }
        print_json({"ok": True, **facts})
        return
    cut = ", ".join(closing.name for closing in structure.closings) or "nothing"
    click.echo(
        f"{loaded.name} ({structure.architecture}) is right. Independent loops: {structure.loops}, "
        f"closed to {assembly.residual:.1e}. Equations come from {cut}."
    )
    if assembly.moved:
        click.echo(f"Note: {assembly.moved_text}.")
    if known:
        click.echo("Variants, for --variant:")
    width = max(map(len, known), default=0)
    for name, variant in known.items():
        click.echo(f"  {name:{width}}  {variant.about}".rstrip())
