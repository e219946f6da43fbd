"""Inverse and direct geometry: every solution of the closure equations, and paths through them."""
