"""What the parts of a report are made of.

view (a diagnosis as its report needs it, with units), tables, section (the parts themselves, and a
figure as a picture).
"""
