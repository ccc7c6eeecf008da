"""What is doubtful before or after a search.

caution          a reason to doubt a verdict
parameters       of the diagnosis itself
columns          outputs among the inputs, wrong units, exchanged columns
data             single rows that are far off, copies, exact data, wrong signs, lost digits
cost             simulations that take long
roughness        simulations that jump
emulator         what the runs leave open at the measured rows
residuals        whether the residuals of the measured rows look like noise
detectable       the smallest fault that would have shown
identifiability  causes that a parameter can imitate
"""
