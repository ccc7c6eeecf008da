"""Causes over columns that the simulation ignores: a kind a file."""
