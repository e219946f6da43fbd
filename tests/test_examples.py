"""Every example script runs, and what it prints stands in the docs."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
PAGES = "\n".join(page.read_text("utf-8") for page in (ROOT / "docs").glob("*.md"))


def stripped(text):
    return "\n".join(line.rstrip() for line in text.splitlines())


@pytest.mark.parametrize("script", EXAMPLES, ids=lambda script: script.name)
def test_an_example_prints_what_the_docs_show(script):
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, check=True)
    assert stripped(done.stdout).strip() in stripped(PAGES)
