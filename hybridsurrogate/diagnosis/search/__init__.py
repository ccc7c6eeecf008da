"""Screen every cause, score the most probable, accept the best, repeat.

setup              from a fitted estimator to problem, causes and emulator
context            what a search looks at; one model fitted to it; interrupts
candidate          a cause at its best with its evidence; probabilities of several
search             every cause fitted and compared with "nothing is wrong"; what each predicts
processes          the winners given a curve of any shape, and given shared noise
exact_scores       the best causes, placed together and scored by importance sampling
null_test          the p-value of the whole search
forward_selection  several causes, one after the other, each compared again given the others
simulated          data sets with a known cause, and what the search would say of each
"""
