"""Causes that add to the output: a kind a file."""
