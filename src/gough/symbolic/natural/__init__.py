"""Closure equations in natural coordinates: `closure` has the idea, the other files its steps."""

from gough.symbolic.natural.closure import NaturalClosure

__all__ = ["NaturalClosure"]
