"""The evidence of a cause by its linearised model: what a search screens by.

grid                 which unknowns are enumerated, and where
linearised           the model around one point
marginal_likelihood  its evidence in closed form, and Gauss-Newton steps to the best fit
outliers             the same where some rows are outliers
levenberg_marquardt  fits from many starts
settings             the numbers that a search is tuned by
"""
