"""What a fit of a diagnosis does, as functions that pass values on.

diagnose    from measured rows to a result: check, compare, conclude, extend
conclusion  verdict and doubts of a finished search
verdict     what a search amounts to: one rule
extension   the model after, and what it says about the causes
folds       the gain, from the whole search repeated
result      all that was found, in one object
sensitivity  the verdict under other priors
"""
