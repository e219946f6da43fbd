"""Every example of the docs runs and prints what stands behind it."""

import contextlib
import io
import re
import shlex
from pathlib import Path

import pytest
from click.testing import CliRunner

from gough import Robot
from gough.cli import main
from gough.formats.native import Source

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def blocks():
    for page in PAGES:
        text = page.read_text("utf-8")
        found = [
            (match[1], match[2], text[: match.start()].count("\n") + 1)
            for match in BLOCK.finditer(text)
        ]
        for k, (language, body, line) in enumerate(found):
            follows = found[k + 1] if k + 1 < len(found) else ("", "", 0)
            output = follows[1] if follows[0] == "text" else None
            yield pytest.param(language, body, output, id=f"{page.name}:{line}")


ROUNDING = re.compile(r"(rank gap +|closed to )[0-9.e+-]+( in \d+ steps)?")


def stripped(text):
    """The lines, with figures that rounding decides left out: processors differ in them."""
    lines = (ROUNDING.sub(r"\1…", line.rstrip()) for line in text.strip().splitlines())
    return "\n".join(lines)


BLOCKS = list(blocks())
PYTHON = [b for b in BLOCKS if b.values[0] == "python"]
CONSOLE = [b for b in BLOCKS if b.values[0] == "console"]
YAML = [b for b in BLOCKS if b.values[0] == "yaml" and b.values[1].startswith("name:")]


@pytest.mark.parametrize(("language", "code", "output"), PYTHON)
def test_python_examples(language, code, output, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(code, "example", "exec"), {"__name__": "example"})
    assert output is not None or not printed.getvalue()
    if output is not None:
        assert stripped(printed.getvalue()) == stripped(output)


@pytest.mark.parametrize(("language", "text", "output"), CONSOLE)
def test_console_examples(language, text, output, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for part in re.split(r"^\$ ", text, flags=re.MULTILINE)[1:]:
        command, _, expected = part.partition("\n")
        words = shlex.split(command)
        if words[0] != "gough":
            continue
        result = CliRunner().invoke(main, words[1:])
        assert stripped(result.output) == stripped(expected), command


@pytest.mark.parametrize(("language", "text", "output"), YAML)
def test_yaml_examples_close(language, text, output):
    robot = Robot(Source(text.encode(), "example.yaml").mechanism())
    assert robot.home.assembly.residual < 1e-12


def test_there_are_examples_to_run():
    assert len(PYTHON) >= 2
    assert CONSOLE
    assert YAML


def test_links_between_pages_lead_somewhere():
    for page in PAGES:
        for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", page.read_text("utf-8")):
            assert (page.parent / target).exists(), f"{page.name} links to {target}"
