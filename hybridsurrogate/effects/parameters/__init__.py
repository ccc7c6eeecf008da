"""Causes that change a factor, a constant or a parameter: a kind a file."""
