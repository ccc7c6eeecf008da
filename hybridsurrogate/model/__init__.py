"""How measured rows follow from the simulation, and what is known once they are fitted.

rows/                   measured rows: columns, experiments, weights, several outputs
context                 what a cause may use before it is fitted
effects                 what causes do to rows
observation             surrogate, causes and priors wired into arrays
validation              what a cause returns, checked by name
finite_differences      steps of slopes, and unknowns that share a run
working_point           any likelihood expanded into normal rows
transformed_simulation  the simulation on the scale of eta
statistics              all that a conditionally Gaussian fit needs of rows and of runs
powers                  powers of the two likelihoods from beta
prior_density           of the standard normal unknowns and sigma
problem                 model, rows, runs, likelihood and priors: all that is fitted
posterior               draws, and what they predict
prior_only              effects that the measured rows do not inform
"""
