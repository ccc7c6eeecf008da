"""Causes that make something else of the simulated output itself, or act on it again and again."""
