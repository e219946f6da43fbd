"""What a command costs from start to end, as whole processes: ``python -m benchmarks.start``.

Medians over several runs; ``--json`` prints one object.
"""

import json
import statistics
import subprocess
import sys
import time

RUNS = 7
COMMANDS = {
    "python alone": ["-c", "pass"],
    "import gough": ["-c", "import gough"],
    "gough --help": ["-m", "gough", "--help"],
    "gough list": ["-m", "gough", "list"],
    "gough check 2rpr": ["-m", "gough", "check", "2rpr"],
    "gough analyse orthoglide": ["-m", "gough", "analyse", "orthoglide"],
}


def milliseconds(arguments):
    start = time.perf_counter()
    subprocess.run([sys.executable, *arguments], stdout=subprocess.DEVNULL, check=True)
    return 1e3 * (time.perf_counter() - start)


def measure():
    """Median milliseconds of every command, each run in turn so that a slow moment hits all."""
    times = {name: [] for name in COMMANDS}
    for _ in range(RUNS):
        for name, arguments in COMMANDS.items():
            times[name].append(milliseconds(arguments))
    return {name: statistics.median(values) for name, values in times.items()}


if __name__ == "__main__":
    found = measure()
    if "--json" in sys.argv:
        print(json.dumps({"milliseconds": found}, indent=1))
    else:
        alone = found["python alone"]
        for name, value in found.items():
            print(f"{name:<26}{value:8.0f} ms {value / alone:8.1f} × python alone")
