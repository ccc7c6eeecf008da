"""The whole diagnosis once more on some of the rows: what the extension gains.

folds             rows that are held out, within the measured range and beyond
refit             search and extension on the others
cross_validation  all folds
gain              scores before and after
beta_scan         the best weight of the simulation before and after
parallel          folds on several processes
progress          what is being done, on a terminal
"""
