"""The error function."""

from __future__ import annotations

from gough.kernels.functions.exponentials import exp
from gough.kernels.value import Value, polynomial, where

SIGN = 1 << 63

# Chebyshev interpolation of erf(x)/x - 1 in x² on |x| ≤ 1, see tools/minimax.py
ERF = [
    *(0.12837916709551256, -0.37612638903183543, 0.11283791670945006, -0.02686617064323777),
    *(
        0.0052239776071164225,
        -0.0008548325975389692,
        0.00012055294904839707,
        -1.492473690741966e-05,
    ),
    *(
        1.6447424703317362e-06,
        -1.6208483801871705e-07,
        1.3720064546777686e-08,
        -7.795898827002142e-10,
    ),
]
# and of exp(x²) erfc(x) in 1/(x + 2) on 1 ≤ x ≤ 6
ERFCX = [
    *(1.6242284740077591e-07, 0.5641771458640458, 1.1288205669506493, 1.9650380653313524),
    *(2.965062607613792, 1.112927254027886, 12.469269695695969, -86.0235241240357),
    *(356.0254348102813, -1304.8727117633393, 3393.7192897611894, -5751.745781926398),
    *(6141.244973872164, -3802.3193399400056, 1051.4775993545124),
]


def erf(x: Value) -> Value:
    """2/√π ∫ exp(-t²) dt from 0 to x; 1.5 ulp.

    Near 0 a polynomial; beyond 1, 1 - exp(-x²) (exp(x²) erfc x) (Muller, Elementary Functions).
    """
    size = abs(x)
    small = where(size < 1.0, x, 0.0)
    near = small + small * polynomial(small * small, ERF)
    far_size = where(size > 6.0, 6.0, where(size > 1.0, size, 1.0))  # at 6 it is 1
    tail = exp(-(far_size * far_size)) * polynomial(1.0 / (far_size + 2.0), ERFCX)
    far = ((1.0 - tail).word() ^ (x.word() & SIGN)).real()
    return where(size < 1.0, near, where(size >= 1.0, far, x))
