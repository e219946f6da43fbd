"""Sine and cosine of angles of any size, by the method of Payne and Hanek (1983).

With x = m 2ᵉ, m of 53 bits, the product m · (2/π) 2ᵉ is needed modulo 4 only: bits of 2/π above a
place have no effect, and 192 bits from there leave an error below 2⁻¹³⁷, while no float64 comes
nearer to a multiple of π/2 than 2⁻⁶².
"""

from __future__ import annotations

from functools import cache

from gough.kernels.builder import Builder
from gough.kernels.functions.parts import SIGN
from gough.kernels.functions.sines import Reduced, sin_cos_of
from gough.kernels.tape import Tape
from gough.kernels.value import Value, where

TWO_OVER_PI = (
    *(0x0000000000000000, 0xA2F9836E4E441529, 0xFC2757D1F534DDC0, 0xDB6295993C439041),
    *(0xFE5163ABDEBBC561, 0xB7246E3A424DD2E0, 0x06492EEA09D1921C, 0xFE1DEB1CB129A73E),
    *(0xE88235F52EBB4484, 0xE99C7026B45F7E41, 0x3991D639835339F4, 0x9C845F8BBDF9283B),
    *(0x1FF897FFDE05980F, 0xEF2F118B5A0A6D1F, 0x6D367ECF27CB09B7, 0x4F463F669E5FEA2D),
    *(0x7527BAC7EBE5F17B, 0x3D0739F78A5292EA, 0x6BFB5FB11F8D5D08, 0x56033046FC7B6BAB),
)
"""The bits of 2/π after 64 zeros."""
ONES = 2**64 - 1
LOW = 2**32 - 1
HALF_PI = float.fromhex("0x1.921fb54442d18p+0")
HALF_PI_HIGH = float.fromhex("0x1.921fb50000000p+0")  # its first 26 bits
HALF_PI_LOW = float.fromhex("0x1.110b460000000p-26")  # and the others
HALF_PI_TAIL = float.fromhex("0x1.1a62633145c07p-54")  # π/2 less HALF_PI


@cache
def routine(name: str) -> Tape:
    """The tape of ``sin`` or ``cos`` for angles beyond the fast range; infinities give NaN."""
    builder = Builder(1)
    x = Value.input(builder, 0)
    sine, cosine = sin_cos_of(_reduced(abs(x)))
    odd = (sine.word() ^ (x.word() & SIGN)).real()
    result = where(abs(x) < float("inf"), odd if name == "sin" else cosine, float("nan"))
    return builder.tape([result.number])


def _reduced(x: Value) -> Reduced:
    """A positive angle less a whole number of quarter turns."""
    bits = x.word()
    mantissa = (bits & (2**52 - 1)) | 2**52
    place = (bits >> 52) - 1013  # of the first bit of the table that counts
    turns = _product(mantissa, _window(place))  # fixed point: two bits, then the fraction
    quarters = (turns[0] >> 62) + ((turns[0] >> 61) & 1)
    fraction = _shifted_by_two(turns)
    negative = _all_ones_if(fraction[0] >> 63)
    rest, lost = _angle(_negated_where(negative, fraction))
    sign = negative & SIGN
    return Reduced((rest.word() ^ sign).real(), (lost.word() ^ sign).real(), quarters)


def _window(place: Value) -> list[Value]:
    """The 192 bits of the table from a place on."""
    words: list[Value] = [place.like(word) for word in TWO_OVER_PI]
    index, shift = place >> 6, place & 63
    for power in (16, 8, 4, 2, 1):
        chosen = _all_ones_if((index >> (power.bit_length() - 1)) & 1)
        kept = 3 + power  # so many words can still be reached
        later = words[power:]
        words = [
            word ^ ((word ^ later[k]) & chosen) if k < len(later) else word
            for k, word in enumerate(words[:kept])
        ]
    left = [word.emit("shift_left", shift) for word in words]
    right = [(word >> 1).emit("shift_right", shift.like(63) - shift) for word in words]
    return [left[k] | right[k + 1] for k in range(3)]


def _all_ones_if(bit: Value) -> Value:
    return bit.like(0) - bit


def _product(m: Value, words: list[Value]) -> list[Value]:
    """m times a number of three words, modulo 2¹⁹²; the first word is the highest."""
    high, middle, low = words
    second = m * middle
    sum_ = second + _high_half(m, low)
    top = m * high + _high_half(m, middle) + _carry(second, _high_half(m, low), sum_)
    return [top, sum_, m * low]


def _high_half(a: Value, b: Value) -> Value:
    """The upper word of the product of two words."""
    (a1, a0), (b1, b0) = [(x >> 32, x & LOW) for x in (a, b)]
    cross, other = a1 * b0, a0 * b1
    middle = ((a0 * b0) >> 32) + (cross & LOW) + (other & LOW)
    return a1 * b1 + (cross >> 32) + (other >> 32) + (middle >> 32)


def _carry(a: Value, b: Value, total: Value) -> Value:
    return ((a & b) | ((a | b) & (total ^ ONES))) >> 63


def _shifted_by_two(words: list[Value]) -> list[Value]:
    high, middle, low = words
    return [(high << 2) | (middle >> 62), (middle << 2) | (low >> 62), low << 2]


def _negated_where(chosen: Value, words: list[Value]) -> list[Value]:
    """Minus the number where all bits are ones, the number where they are zeros."""
    result, carry = [], chosen & 1
    for word in reversed(words):
        turned = word ^ chosen
        total = turned + carry
        carry = _carry(turned, carry, total)
        result.append(total)
    return result[::-1]


def _angle(words: list[Value]) -> tuple[Value, Value]:
    """A fraction of a quarter turn in fixed point as an angle: a real less a small one."""
    pieces = [piece for word in words for piece in (word >> 32, word & LOW)]
    high = _real(pieces[0], 1)
    low = high.like(0.0)
    for k, piece in enumerate(pieces[1:5], start=2):
        small = _real(piece, k)
        total = high + small
        low = low + (small - (total - high))  # exact (Dekker 1971)
        high = total
    front = (high.word() & (ONES << 27)).real()
    back = high - front
    product = high * HALF_PI
    error = (front * HALF_PI_HIGH - product) + front * HALF_PI_LOW + back * HALF_PI_HIGH
    error = error + back * HALF_PI_LOW + (high * HALF_PI_TAIL + low * HALF_PI)
    rest = product + error
    return rest, (rest - product) - error  # exact (Dekker 1971)


def _real(piece: Value, place: int) -> Value:
    """A whole number below 2³² times 2 to the power of minus 32 times its place, exact."""
    return ((piece | (0x433 << 52)).real() - 2.0**52) * 2.0 ** (-32 * place)
