"""Causes that change the noise: a kind a file."""
