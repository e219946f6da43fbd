"""The seam between scalar expressions and arrays: an expression becomes a function of arrays."""

from gough.kernels.kernel import Kernel

__all__ = ["Kernel"]
