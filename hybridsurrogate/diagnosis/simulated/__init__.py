"""Data sets with a known cause, and what the linearised evidence of all causes says of each.

place       where all causes are linearised: rows, parameters and noise without a cause
hidden      causes of a given size, drawn from their priors
outcomes    what a diagnosis would conclude from each of many data sets
detectable  the smallest size of each kind that a finished search would have detected
"""
