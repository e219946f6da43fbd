"""The error function."""

from __future__ import annotations

from gough.kernels.functions.exponentials import missing, reduced
from gough.kernels.functions.parts import with_sign_of
from gough.kernels.value import Value, polynomial, where

LARGEST = 5.9375
"""Beyond this the result is ±1."""

# minimax polynomials of erf(x)/x - 1 in x² on |x| ≤ 1 and of -ln(1 - erf x)/x up to LARGEST, the
# latter with the weight x (1 - erf x)/erf x, see tools/minimax.py
ERF = [
    *(0.1283791670955126, -0.376126389031841, 0.11283791670971101, -0.02686617064803224),
    *(0.005223977652708886, -0.000854832853705061, 0.00012055386249992171),
    *(-1.4926883076213634e-05, 1.6481088596591206e-06, -1.655748401248158e-07),
    *(1.6015866170288853e-08, -1.6475879945407764e-09, 1.4363925019396339e-10),
]
ERFC = [
    *(1.1283791108446664, 0.6366202527975356, 0.10277082659844286, -0.01912496347966518),
    *(-0.00021203848580248638, 0.0016926105196615924, -0.0005746611610769334),
    *(-9.73105667542096e-07, 9.548565684276487e-05, -5.6038204886088883e-05),
    *(2.035129039981659e-05, -5.385236734871258e-06, 1.0781296634003224e-06),
    *(-1.630244379346092e-07, 1.8130801673752583e-08, -1.4024233245685573e-09),
    *(6.74473128547623e-11, -1.5188311975009343e-12),
]


def erf(x: Value) -> Value:
    """Error function; 1.5 ulp and never beyond ±1.

    It is x + x P(x²) up to 1, then 1 - exp(-x Q(x)), for which few bits of Q are needed.
    """
    size = abs(x)
    square = size * size
    small = size + size * polynomial(square, ERF)
    limited = where(size > LARGEST, LARGEST, size)
    high, low, word = reduced(-(limited * polynomial(limited, ERFC)), 1023)
    rest = (1.0 + (high - missing(high, low))) * (word << 52).real()
    return with_sign_of(where(size < 1.0, small, 1.0 - rest), x)
