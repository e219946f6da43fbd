import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.ensembles.tasks import marks

ROOT = Path(__file__).parents[2]


@pytest.fixture
def started():
    """Starts a run in a process of its own and returns when it has some chunks."""
    processes = []

    def start(folder, seconds=0.05, chunks=3):
        process = subprocess.Popen(
            [sys.executable, "-m", "tests.ensembles.tasks", str(folder), str(seconds)],
            cwd=ROOT,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        processes.append(process)
        end = time.monotonic() + 60
        while marks(folder) < chunks:
            assert process.poll() is None, process.communicate()
            assert time.monotonic() < end
            time.sleep(0.01)
        return process

    yield start
    for process in processes:
        if process.poll() is None:
            process.kill()
        process.communicate()


@pytest.fixture
def small_disk(tmp_path):
    """Mounts a file system of some size at a folder; skips where that is not allowed."""
    mounted = []

    def mount(options, *, again=False):
        place = tmp_path / "disk"
        place.mkdir(exist_ok=True)
        both = f"remount,{options}" if again else options
        command = ["mount", "-t", "tmpfs", "-o", both, "tmpfs", str(place)]
        try:
            if sys.platform != "linux" or os.geteuid() or subprocess.run(command).returncode:
                pytest.skip("mounting needs Linux and root")
        except FileNotFoundError:
            pytest.skip("there is no mount")
        mounted[:] = [place]
        return place

    yield mount
    for place in mounted:
        subprocess.run(["umount", str(place)], check=True)
