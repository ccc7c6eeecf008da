"""Arguments that a user gives: one check for each kind, which says what was expected and what came.

description   a value in a few words, for a message
named         dicts by name, lists of names, single names
scalars       numbers, counts, yes or no, one of several words
functions     what can be called, and what can be pickled
paths         files to read and to write: no addresses, no folders
"""
