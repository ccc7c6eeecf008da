"""The extended model as Python source.

extended_model (what a module is written of), text (names and numbers), parts (what each cause is
called there), functions (of the causes, and the extended simulation), dynamics (a changed ODE),
helpers, docstring.
"""
