"""Machine code on disk: whole, bounded, shared, and never trusted blindly."""

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import pytest

from gough.cache import MAGIC, Cache, digest, from_environment
from gough.errors import ConfigurationError

KEY, OTHER = digest("one"), digest("other")
CODE = b"\x7fELF" + bytes(range(256)) * 8


def test_what_is_put_comes_back(tmp_path):
    cache = Cache(tmp_path / "deep" / "folder")
    assert cache.get(KEY) is None
    cache.put(KEY, CODE)
    assert cache.get(KEY) == CODE
    assert cache.get(OTHER) is None
    assert [p.suffix for p in cache.folder.iterdir()] == [".o"]


@pytest.mark.parametrize(
    "damage",
    [
        lambda whole: b"",
        lambda whole: whole[:-1],
        lambda whole: whole[: len(MAGIC) + 10],
        lambda whole: whole + b"x",
        lambda whole: whole[:60] + bytes([whole[60] ^ 1]) + whole[61:],
        lambda whole: b"another program's file",
    ],
)
def test_a_broken_or_foreign_file_is_not_used_and_replaced(tmp_path, damage):
    cache = Cache(tmp_path)
    cache.put(KEY, CODE)
    path = cache.path(KEY)
    path.write_bytes(damage(path.read_bytes()))
    assert cache.get(KEY) is None
    cache.put(KEY, CODE)
    assert cache.get(KEY) == CODE


def test_the_file_of_another_key_is_not_used(tmp_path):
    cache = Cache(tmp_path)
    cache.put(KEY, CODE)
    os.replace(cache.path(KEY), cache.path(OTHER))
    assert cache.get(OTHER) is None


def test_a_folder_that_can_not_be_written_does_no_harm(tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    cache = Cache(blocked / "inside")
    cache.put(KEY, CODE)
    assert cache.get(KEY) is None


def test_the_oldest_files_go_when_the_folder_is_full(tmp_path):
    cache = Cache(tmp_path, size=0.1)
    keys = [digest(str(k)) for k in range(100)]
    for age, key in enumerate(keys):
        cache.put(key, CODE)
        os.utime(cache.path(key), (1e9 + age, 1e9 + age))
    Cache(tmp_path, size=0.1).put(digest("last"), CODE)
    assert sum(p.stat().st_size for p in tmp_path.iterdir()) <= 0.1e6
    assert cache.get(keys[0]) is None
    assert cache.get(keys[-1]) == CODE


def test_many_writers_and_readers_see_whole_files(tmp_path):
    cache = Cache(tmp_path)

    def work(k):
        cache.put(KEY, CODE)
        return cache.get(KEY) == CODE

    with ThreadPoolExecutor(8) as pool:
        assert all(pool.map(work, range(200)))
    assert len(list(tmp_path.iterdir())) == 1


def test_the_environment_chooses_folder_and_switch(monkeypatch, tmp_path):
    monkeypatch.setenv("GOUGH_CACHE_DIR", str(tmp_path))
    monkeypatch.setenv("GOUGH_CACHE_SIZE", "12.5")
    assert from_environment().folder == tmp_path
    assert from_environment().size == 12.5
    monkeypatch.delenv("GOUGH_CACHE_DIR")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    if sys.platform.startswith("linux"):
        assert from_environment().folder == tmp_path / "xdg" / "gough"
    monkeypatch.setenv("GOUGH_CACHE", "off")
    assert from_environment().folder is None


@pytest.mark.parametrize(("name", "value"), [("GOUGH_CACHE", "maybe"), ("GOUGH_CACHE_SIZE", "-1")])
def test_settings_without_meaning_are_refused(monkeypatch, name, value):
    monkeypatch.setenv(name, value)
    with pytest.raises(ConfigurationError, match=f"{name} is '{value}', expected"):
        from_environment()


PROGRAM = """
import casadi
from gough.kernels import Kernel
x = casadi.SX.sym("x", 3)
kernel = Kernel("k", {"x": x}, casadi.sin(x) * x[0])
print(kernel([1.0, 2.0, 3.0])[1, 0].hex())
"""


def run_program(**environment):
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.strip()


def test_processes_share_code_and_survive_damage(tmp_path):
    folder = {"GOUGH_CACHE_DIR": str(tmp_path)}
    first = run_program(**folder)
    files = sorted(tmp_path.iterdir())
    assert files
    assert run_program(**folder) == first
    assert sorted(tmp_path.iterdir()) == files
    for file in files:
        file.write_bytes(MAGIC + b"damaged")
    assert run_program(**folder) == first
    assert all(file.stat().st_size > 100 or len(file.read_bytes()) > 60 for file in files)


def test_without_a_cache_nothing_is_written(tmp_path):
    run_program(GOUGH_CACHE="off", GOUGH_CACHE_DIR=str(tmp_path))
    assert not list(tmp_path.iterdir())
