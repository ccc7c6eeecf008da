"""A simulation known from its runs, with the error of what they leave open.

conditioned     a Gaussian process through the runs on a polynomial's terms
polynomial      a polynomial, and its error
left_out        runs predicted from all others
emulator        the estimator
"""
