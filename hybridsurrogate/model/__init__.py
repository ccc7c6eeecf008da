"""How measured rows follow from the simulation, and what is known once they are fitted.

rows/        measured rows: columns, experiments, weights, several outputs
context      what a cause may use before it is fitted, and checks of what it returns
effects      what causes do to rows
observation  surrogate, causes and priors wired into arrays
statistics   all that a conditionally Gaussian fit needs of rows and of runs
problem      model, rows, runs, likelihood and priors: all that is fitted
posterior    draws, and what they predict
"""
