"""Models of a mechanism as scalar expressions (CasADi SX)."""
