"""Causes that move the inputs: a kind a file."""
