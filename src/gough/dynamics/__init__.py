"""Dynamics of mechanisms with loops: inverse and direct models and what they are made of."""
