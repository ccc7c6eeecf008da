"""What the parts of a report are made of.

view (a diagnosis as its report needs it, with units), tables, drawing (a figure as a picture),
section (the parts themselves), settings.
"""
