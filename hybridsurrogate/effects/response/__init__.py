"""Causes that make something else of the simulated output itself."""
