"""What a fit of a diagnosis does, as functions that pass values on.

diagnose     from measured rows to a result: check, compare, conclude, extend, hold out
verdict      what a search amounts to, and what makes it doubtful: one rule
result       all that was found, in one object
sensitivity  the verdict under other priors
"""
