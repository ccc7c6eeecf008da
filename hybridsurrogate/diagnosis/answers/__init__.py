"""What a search reports to its user.

table                    the table of all causes
failures                 parameters for which the simulation fails
discrepancy              where and how much the simulation is wrong
finding                  the detected causes, in numbers and formulas
extension                the user's simulation with a cause in it
alternative_predictions  what each alternative predicts
unknown_beyond           the remainder that an extension keeps beyond the measured range
experimental_design      where one more measurement informs most
next_runs                which further runs inform most
model_averaging          predictions averaged over causes
monitor                  whether new measurements agree with the extension
"""
