"""From checked data to a problem that can be fitted.

columns                 measured columns by name, and rows outside the simulated range
rows                    measured rows and their weights
context                 what a cause may use before it is fitted
problem                 surrogate, causes, likelihood and priors wired up
transformed_simulation  the simulation on the scale of eta
"""
