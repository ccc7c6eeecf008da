"""What is doubtful before or after a search.

parameters       of the diagnosis itself
data             copies, exact data, wrong signs, lost digits
cost             simulations that take long
roughness        simulations that jump
emulator         what the runs leave open at the measured rows
identifiability  causes that a parameter can take the place of
"""
