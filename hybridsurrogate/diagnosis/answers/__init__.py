"""What a search reports to its user.

finding              the detected causes and the table of all, in numbers and formulas
discrepancy          where and how much the simulation is wrong
extension            the user's simulation with a cause in it
averaging            predictions averaged over causes, and what is kept for the unknown beyond
experimental_design  where one more measurement informs most, and which further runs
monitor              whether new measurements agree with the extension
"""
