"""Kernels in C give the bits of the plain meaning of their tapes."""

import ctypes
import shutil
import subprocess

import numpy as np
import pytest
from hypothesis import given

from gough.errors import ConfigurationError
from gough.kernels import c_family
from gough.kernels.builder import Builder
from gough.kernels.c import c_source
from gough.kernels.parts import parts
from gough.kernels.tape import PRIMITIVES, Instruction, Tape, evaluate
from gough.kernels.value import Value, where
from tests.kernels.c_files import Case, cases, check_all, compiled, how_many
from tests.kernels.random_tapes import Exact, assert_same, exact_run, special_rows, tapes

needs_gcc = pytest.mark.skipif(shutil.which("gcc") is None, reason="there is no gcc")
STRICT = ["-O2", "-ffp-contract=off", "-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic"]
SHARED = ("gcc", "-shared", "-fPIC")
A_FILE = 500
"""Kernels in one file."""


def library(directory, checked, *flags):
    texts = []
    for case in checked:
        files = c_source(case.name, case.tape, case.inputs)
        (directory / f"{case.name}.h").write_text(files.header)
        texts.append(files.source)
    return compiled(directory / "kernels.c", "\n".join(texts), *SHARED, *flags)


@needs_gcc
def test_random_kernels_have_the_bits_of_the_reference(tmp_path):
    for first in range(0, count := how_many(200), A_FILE):
        checked = cases(first, min(A_FILE, count - first))
        directory = tmp_path / str(first)
        directory.mkdir()
        check_all(library(directory, checked, *STRICT), checked, "{}_batch")


@needs_gcc
@pytest.mark.parametrize(
    "flags",
    [
        STRICT,
        [*STRICT, "-march=native"],
        # the pragma must do what -ffp-contract=off does
        ["-O3", "-march=native", "-std=gnu99", "-Wall", "-Werror"],
        ["-O0", "-std=c11"],
    ],
    ids=["plain", "native", "no flag", "unoptimised"],
)
def test_fused_kernels_have_the_same_bits_on_every_machine(tmp_path, flags):
    checked = cases(1, how_many(60), fused=True)
    check_all(library(tmp_path, checked, *flags), checked, "{}_batch")


@needs_gcc
def test_minus_a_fused_sum_of_zero_is_minus_zero(tmp_path):
    """GCC would make fma(-a, b, -c) of -fma(a, b, c), with the other sign for a = c = 0."""
    inputs = [Instruction("input", (k,)) for k in range(3)]
    tape = Tape(3, [*inputs, Instruction("fma", (0, 1, 2)), Instruction("neg", (3,))], [4])
    rows = np.zeros((32, 3))
    case = Case("fused", tape, {"q": 3}, rows, np.full((32, 1), -0.0))
    check_all(library(tmp_path, [case], *STRICT, "-march=native"), [case], "{}_batch")


@needs_gcc
def test_large_angles(tmp_path):
    checked = cases(2, 8, size=60, careful=True)
    used = {op for case in checked for op, _ in case.tape.code}
    assert {"careful_sin", "careful_cos"} <= used
    check_all(library(tmp_path, checked, *STRICT), checked, "{}_batch")


@needs_gcc
def test_long_tapes_are_written_in_parts(tmp_path, monkeypatch):
    monkeypatch.setattr(c_family, "LONGEST", 7)
    checked = cases(3, 30, size=60, fused=True)
    assert "k0_part3(" in c_source("k0", checked[0].tape, checked[0].inputs).source
    check_all(library(tmp_path, checked, *STRICT), checked, "{}_batch")


@needs_gcc
def test_every_operation_on_literals_compiles(tmp_path):
    literals = [("constant", x) for x in (0.0, -0.0, np.inf, np.nan, 5e-324, 1.7e308, -3.0)]
    leaf = {"real": literals, "truth": [("flag", True)], "word": [("bits", 2**63)]}
    code, outputs = [], []
    for op, (kinds, result) in PRIMITIVES.items():
        if "careful" in op or "shift" in op:
            continue
        for k in range(len(literals)):
            operands = []
            for kind in kinds:
                name, value = leaf[kind][k % len(leaf[kind])]
                operands.append(len(code))
                code.append(Instruction(name, (1.0 if op == "to_word" else value,)))
            code.append(Instruction(op, tuple(operands)))
            if result == "real":
                outputs.append(len(code) - 1)
    case = Case.of(np.random.default_rng(0), "literals", Tape(0, code, outputs))
    check_all(library(tmp_path, [case], *STRICT), [case], "{}_batch")


def small():
    b = Builder(3)
    x, y, z = (Value.input(b, k) for k in range(3))
    return b.tape([where(x < y, x * z + 0.1, y / z).number, x.number])


@needs_gcc
def test_one_row(tmp_path):
    tape = small()
    case = Case.of(np.random.default_rng(1), "small", tape)
    case = Case("small", tape, {"q": 2, "nothing": 0, "p": 1}, case.rows, case.expected)
    loaded = library(tmp_path, [case], *STRICT)
    out = (ctypes.c_double * 2)()
    loaded.small((ctypes.c_double * 2)(2.0, 3.0), (ctypes.c_double * 1)(5.0), out)
    assert list(out) == [2.0 * 5.0 + 0.1, 2.0]


@needs_gcc
def test_flags_that_change_numbers_are_refused(tmp_path):
    case = Case.of(np.random.default_rng(1), "small", small())
    library(tmp_path, [case], "-O2")
    command = [*SHARED, "-ffast-math", "kernels.c", "-o", "fast.so"]
    ended = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert ended.returncode != 0
    assert "-ffast-math changes the numbers: compile without it" in ended.stderr


@needs_gcc
@pytest.mark.skipif(shutil.which("g++") is None, reason="there is no g++")
def test_the_header_is_for_cplusplus_too(tmp_path):
    files = c_source("small", small(), {"q": 2, "p": 1})
    (tmp_path / "small.h").write_text(files.header)
    (tmp_path / "small.c").write_text(files.source)
    main = (
        '#include "small.h"\nint main() { double q[2] = {}, p[1] = {}, out[2]; small(q, p, out); }'
    )
    (tmp_path / "main.cpp").write_text(main)
    for command in (
        "gcc -std=c99 -c small.c -o small.o",
        "g++ -Wall -Wextra -Werror main.cpp small.o -lm -o main",
        "./main",
    ):
        subprocess.run(command.split(), cwd=tmp_path, check=True)


def test_the_comment_tells_shapes_and_operations():
    about = "twice */ something\nand more"
    files = c_source("small", small(), {"q": 2, "p": 1}, about=about, shape=(2, 1))
    lines = files.source.splitlines()
    assert lines[:8] == [
        "/* small: twice * / something",
        " * and more",
        " *",
        " *   q    (2,)",
        " *   p    (1,)",
        " *   out  (2, 1), rows vary slowest",
        " *",
        " * Operations for a row: 5 (1 mul, 1 add, 1 div, 1 select, 1 compare).",
    ]
    assert files.header.startswith("\n".join(lines[:8]))
    assert " * Compile with -ffp-contract=off" in lines[8]
    assert max(map(len, lines)) <= 100


@pytest.mark.parametrize("name", ["3rpr", "my kernel", "", "int", "sin", "_x", "größe", "fma"])
def test_names_that_c_does_not_take_are_refused(name):
    with pytest.raises(ConfigurationError, match="call it 'kernel_") as refused:
        c_source(name, small(), {"q": 3})
    other = str(refused.value).split("'")[-2]
    assert f"void {other}(" in c_source(other, small(), {"q": 3}).source


@pytest.mark.parametrize("label", ["v12", "out", "class", "a-b", "small", "small_word", "floor"])
def test_names_of_inputs_that_would_clash_are_refused(label):
    with pytest.raises(ConfigurationError, match=f"input '{label}' .*; call it 'input_"):
        c_source("small", small(), {label: 3})


def test_the_same_tape_gives_the_same_text():
    tape = cases(4, 1, size=200)[0].tape
    assert c_source("a", tape, {"q": tape.inputs}) == c_source("a", tape, {"q": tape.inputs})


@given(tapes(fused=True))
def test_parts_do_together_what_the_tape_does(tape):
    rows = special_rows(np.random.default_rng(0), tape, 20)
    pieces, kept = parts(tape, 9)
    columns, memory, out = list(rows.T), [None] * kept, [None] * len(tape.outputs)
    for part in pieces:
        with np.errstate(all="ignore"):
            results = evaluate(part.tape, Exact, [*columns, *memory])
        for place, result in zip(part.keeps, results, strict=False):
            memory[place] = result
        for place, result in zip(part.outputs, results[len(part.keeps) :], strict=True):
            out[place] = result
    found = np.stack([np.broadcast_to(column, len(rows)) for column in out], axis=-1)
    assert_same(found, exact_run(tape, rows))
