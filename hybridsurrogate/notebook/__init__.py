"""What a notebook shows of results.

tables  small tables as HTML, escaped, of numbers that are there already
"""

from hybridsurrogate.notebook.tables import table

__all__ = ["table"]
