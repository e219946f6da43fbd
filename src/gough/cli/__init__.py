"""The command ``gough``; each subcommand is one file, imported when it is asked for."""

from __future__ import annotations

from importlib import import_module

import click

from gough import __version__

COMMANDS = {
    "analyse": "Mobility, redundancy and singularity of a mechanism.",
    "check": "Check a description: every error of the file at once.",
    "dynamics": "Efforts, powers and energies along a motion.",
    "export": "Models as C or CUDA code, or how many operations they take.",
    "inverse": "Positions of the joints for a pose, on every working mode.",
    "list": "The robots of the catalogue.",
    "modes": "Every assembly mode for some positions of the motors.",
    "simulate": "A motion under the actuators, or an ensemble of motions.",
    "study": "A report on a mechanism, with pictures.",
}


class Commands(click.Group):
    """Subcommands by name; ``--help`` needs only their one-line help."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names of the subcommands."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The subcommand, from its own file."""
        if cmd_name not in COMMANDS:
            return None
        command: click.Command = import_module(f"gough.cli.{cmd_name}_command").command
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """The subcommand that the words name, or an error with the closest name."""
        from gough.errors import closest

        if args and args[0] not in COMMANDS and not args[0].startswith("-"):
            raise click.UsageError(
                f"there is no command {args[0]!r}.{closest(args[0], list(COMMANDS))}"
            )
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the list of subcommands without importing them."""
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))


@click.group(cls=Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="gough")
def main() -> None:
    """Exact models and analysis of robots with closed kinematic loops.

    ROBOT is a description file (see docs/description.md) or a name that `gough list` prints.
    """
