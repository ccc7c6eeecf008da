"""Causes inside the right-hand side of an ODE: a kind a file."""
