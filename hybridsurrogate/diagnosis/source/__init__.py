"""The extended model as Python source.

python_code (a module, from a result), text (names and numbers), parts (what it is written of, and
what each cause is called there), functions (of the causes, and the extended simulation), dynamics
(a changed ODE).
"""
