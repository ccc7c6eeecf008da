"""A simulation known from its runs, with the error of what they leave open.

conditioned  a process through the runs on a polynomial's terms; runs predicted from all others
failures     where runs fail
emulator     the estimator
"""
