"""Screen every cause, score the most probable, accept the best, repeat.

setup              from a fitted estimator to problem, causes and emulator
working_rows       rows of any likelihood, normal to first order
context            what a search looks at; one model fitted to it; interrupts
candidate          a cause at its best with its evidence; probabilities of several
screening          one fit of every cause, and more starts where it looks promising
search             every cause compared with "nothing is wrong"
processes          the winners given a curve of any shape, and given correlated noise
local_prediction   what one cause predicts, given the data
noise_of_outputs   several outputs: each cause with the noise of each that suits it
exact_scores       the best causes, scored under the likelihood by importance sampling
null_test          the p-value of the whole search
joint_refit        two causes placed together
forward_selection  several causes, one after the other, each compared again given the others
"""
