"""Screen every cause, score the most probable, accept the best, repeat.

setup              from a fitted estimator to problem, causes and emulator
working_rows       rows of any likelihood, normal to first order
screening          one fit of every cause, and more starts where it looks promising
local_fit          a fit, its noise, a finer grid where the evidence is; interrupts
noise_of_outputs   several outputs: each cause with the noise of each that suits it
evidence           evidence of all causes, alone and given a curve or correlated noise
exact_scores       the best causes, scored under the likelihood by importance sampling
local_prediction   what one cause predicts, given the data
null_test          the p-value of the whole search
forward_selection  several causes, one after the other
conditioning       where accepted causes are fixed
joint_refit        two causes placed together
backfitting        each cause compared again, given the others
"""
