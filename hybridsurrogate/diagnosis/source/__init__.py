"""The extended model as Python source.

python_code (a module, from a result), extended_model (what it is written of), text (names and
numbers), parts (what each cause is called there), functions (of the causes, and the extended
simulation), dynamics (a changed ODE), helpers, docstring.
"""
