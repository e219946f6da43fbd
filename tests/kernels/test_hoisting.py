"""Tapes in two parts: what depends on held inputs alone, and the rest."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gough.kernels.hoisting import hoisted
from gough.kernels.tape import LEAVES, REAL, RESULTS, Instruction, Tape
from tests.kernels.random_tapes import assert_same, exact_run, random_tape, special_rows

ROWS = 23
MANY = 3000 if settings.get_current_profile_name() == "long" else 150


def composed(tape, held, rows):
    """Outputs by way of both parts."""
    first, rest = hoisted(tape, held)
    others = [k for k in range(tape.inputs) if k not in set(held)]
    numbers = exact_run(first, rows[:, sorted(held)])
    return exact_run(rest, np.concatenate([rows[:, others], numbers], axis=1))


@settings(max_examples=MANY)
@given(st.integers(0, 2**32))
def test_both_parts_give_the_bits_of_the_whole(seed):
    rng = np.random.default_rng(seed)
    tape = random_tape(rng, int(rng.integers(1, 60)), fused=bool(seed % 2), careful=seed % 5 == 0)
    held = [k for k in range(tape.inputs) if rng.random() < 0.6]
    rng.shuffle(held)
    rows = special_rows(rng, tape, ROWS)
    assert_same(composed(tape, held, rows), exact_run(tape, rows))


@settings(max_examples=MANY)
@given(st.integers(0, 2**32))
def test_parts_have_what_they_should(seed):
    """Only reals are handed over, and no real of held reals alone is left to the rest."""
    rng = np.random.default_rng(seed)
    tape = random_tape(rng, int(rng.integers(1, 60)))
    held = [k for k in range(tape.inputs) if rng.random() < 0.6]
    first, rest = hoisted(tape, held)
    assert first.inputs == len(held)
    assert rest.inputs == tape.inputs - len(held) + len(first.outputs)
    assert all(RESULTS[first.code[k].op] == REAL for k in first.outputs)
    assert len(rest.outputs) == len(tape.outputs)
    prepared = range(tape.inputs - len(held), rest.inputs)
    known = [op == "input" and operands[0] in prepared for op, operands in rest.code]
    literal = [op in LEAVES and op != "input" for op, _ in rest.code]
    for op, operands in rest.code:
        if op not in LEAVES and RESULTS[op] == REAL:
            assert not all(known[k] or (literal[k] and _real(rest, k)) for k in operands)
    assert {rest.code[k].operands[0] for k, given in enumerate(known) if given} == set(prepared)


def _real(tape, k):
    return RESULTS[tape.code[k].op] == REAL


def program(inputs, *code, outputs):
    return Tape(inputs, [Instruction(op, operands) for op, *operands in code], outputs)


def test_a_comparison_of_held_numbers_stays_in_the_rest():
    tape = program(
        3,
        ("input", 0),
        ("input", 1),
        ("input", 2),
        ("less", 0, 1),
        ("select", 3, 0, 2),
        ("add", 0, 1),
        ("mul", 5, 2),
        outputs=[4, 6],
    )
    first, rest = hoisted(tape, [0, 1])
    assert [op for op, _ in first.code if op not in LEAVES] == ["add"]
    assert [op for op, _ in rest.code if op not in LEAVES] == ["less", "select", "mul"]
    assert len(first.outputs) == 3  # both held numbers and their sum
    rows = np.array([[1.0, 2.0, 5.0], [2.0, 1.0, 5.0]])
    np.testing.assert_array_equal(composed(tape, [0, 1], rows), [[1.0, 15.0], [5.0, 15.0]])


def test_held_inputs_and_literals_that_are_outputs():
    tape = program(
        2, ("input", 0), ("input", 1), ("constant", 4.0), ("neg", 0), outputs=[0, 2, 1, 3, 0]
    )
    rows = np.array([[3.0, 7.0]])
    for held in ([], [0], [1], [0, 1]):
        np.testing.assert_array_equal(composed(tape, held, rows), [[3.0, 4.0, 7.0, -3.0, 3.0]])
    first, rest = hoisted(tape, [0, 1])
    assert len(first.outputs) == 3
    assert not [op for op, _ in rest.code if op not in LEAVES]


@pytest.mark.parametrize("held", [[], [0, 1, 2]])
def test_nothing_held_and_everything_held(held):
    tape = program(
        3, ("input", 0), ("input", 1), ("input", 2), ("mul", 0, 1), ("add", 3, 2), outputs=[4]
    )
    first, rest = hoisted(tape, held)
    assert len(first.outputs) == (1 if held else 0)
    assert len([op for op, _ in rest.code if op not in LEAVES]) == (0 if held else 2)
    rows = np.random.default_rng(0).normal(size=(5, 3))
    assert_same(composed(tape, held, rows), exact_run(tape, rows))
