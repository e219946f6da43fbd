"""Identification: what a dynamic model is linear in, motions that show it, estimates."""
