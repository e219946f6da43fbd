"""Identification: the parameters a dynamic model is linear in, motions that show them, estimates."""
