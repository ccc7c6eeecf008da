"""The whole diagnosis once more on some of the rows: what the extension gains.

cross_validation  all folds, within the measured range and beyond, on several processes
refit             search and extension on the rows that are not held out
gain              scores before and after
beta_scan         the best weight of the simulation before and after
"""
