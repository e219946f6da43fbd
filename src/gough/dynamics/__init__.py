"""Dynamics of mechanisms with loops: inverse and direct models, what they are made of, their data."""
