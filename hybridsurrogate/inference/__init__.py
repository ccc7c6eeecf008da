"""Inference on arrays: step 1 collapsed, importance draws, emcee, step 2, scan over causes."""
