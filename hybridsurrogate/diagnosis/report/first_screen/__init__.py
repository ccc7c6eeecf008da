"""What a reader of a report sees first.

headline (one sentence, and what explains it), cards (four questions), picture (data,
simulation and extended model), advice (what to do next).
"""
