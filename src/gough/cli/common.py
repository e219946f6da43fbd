"""What the subcommands share: their options, their errors, their output."""

from __future__ import annotations

import functools
import json
import sys
from collections.abc import Callable
from typing import Any, TypeVar

import click

from gough.errors import ClosureError, DescriptionError, GoughError, SingularError

F = TypeVar("F", bound=Callable[..., Any])

WRONG_INPUT, MATHEMATICS_SAYS_NO, INTERRUPTED = 2, 1, 130


def robot_argument(command: F) -> F:
    """The argument ROBOT with the options that change what it is."""
    for option in (
        click.option(
            "--modelling",
            type=click.Choice(["cut-joints", "cut-platform"]),
            help="How the platform is modelled; the description's own way by default.",
        ),
        click.option(
            "--set",
            "settings",
            multiple=True,
            metavar="NAME=VALUE",
            help="Replace the value of a parameter; may be repeated.",
        ),
        click.option(
            "--variant",
            "variants",
            multiple=True,
            metavar="NAME",
            help="Take a variant of the description; may be repeated, in the order of the changes.",
        ),
        click.argument("robot"),
    ):
        command = option(command)
    return command


def json_option(command: F) -> F:
    """The option for one JSON object on standard output and nothing else."""
    return click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")(command)


def seed_option(command: F) -> F:
    """The option for the seed of random choices."""
    return click.option(
        "--seed",
        type=click.IntRange(min=0, max=2**63 - 1),
        default=0,
        show_default=True,
        help="Seed of the random configurations that generic values are taken from.",
    )(command)


class Numbers(click.ParamType):  # type: ignore[type-arg]
    """Numbers or expressions in one text, with commas or spaces between: 0.3, pi/4."""

    name = "numbers"

    def convert(self, value: Any, param: Any, ctx: Any) -> list[float]:
        """The numbers; a message that names the one that can not be read."""
        from gough.description.expression import Expression, ExpressionError

        if isinstance(value, list):
            return value
        texts = [text for text in value.replace(",", " ").split() if text]
        numbers = []
        for text in texts:
            try:
                number = float(Expression.read(text).evaluate({}))
            except (ExpressionError, TypeError) as error:
                self.fail(f"{text!r} is no number: {error}", param, ctx)
            numbers.append(number)
        if not numbers:
            self.fail("expected numbers, with commas or spaces between", param, ctx)
        return numbers


def numbers_option(flag: str, name: str, help_text: str) -> Callable[[F], F]:
    """An option with several numbers."""
    return click.option(flag, name, type=Numbers(), metavar="NUMBERS", help=help_text)


def reporting_errors(command: F) -> F:
    """The command, with errors of ours as messages and exit codes: 2 wrong input, 1 no solution."""

    @functools.wraps(command)
    def wrapped(*args: Any, as_json: bool, **options: Any) -> Any:
        try:
            return command(*args, as_json=as_json, **options)
        except KeyboardInterrupt:
            click.echo("Interrupted.", err=True)
            sys.exit(INTERRUPTED)
        except GoughError as error:
            if as_json:
                print_json(_error_data(error))
            click.echo(str(error), err=True)
            no_answer = isinstance(error, ClosureError | SingularError)
            sys.exit(MATHEMATICS_SAYS_NO if no_answer else WRONG_INPUT)

    return wrapped  # type: ignore[return-value]


def _error_data(error: GoughError) -> dict[str, Any]:
    data: dict[str, Any] = {"error": str(error)}
    if isinstance(error, DescriptionError):
        data["file"] = error.source
        data["problems"] = [
            {
                "line": problem.line,
                "column": problem.column,
                "path": [str(part) for part in problem.path],
                "message": problem.message,
            }
            for problem in error.problems
        ]
    return data


def print_json(data: dict[str, Any]) -> None:
    """One JSON object on standard output."""
    click.echo(json.dumps(data, indent=2, allow_nan=False))


def parsed(settings: tuple[str, ...]) -> dict[str, Any]:
    """Parameter values from ``NAME=VALUE`` texts: numbers, expressions, or lists of them.

    Raises:
        DescriptionError: a text has no ``=``, or its value can not be read.
    """
    from gough.errors import Problem
    from gough.formats.nodes import compose

    values: dict[str, Any] = {}
    for setting in settings:
        name, equals, text = setting.partition("=")
        if not equals or not name.strip() or not text.strip():
            problem = Problem(f"expected NAME=VALUE, such as --set L=0.4; got {setting!r}")
            raise DescriptionError([problem], "--set")
        values[name.strip()] = compose(text.encode(), f"--set {name.strip()}").data
    return values
