"""What a notebook shows of results, and of work that goes on.

tables  small tables as HTML, escaped, of numbers that are there already
bars    progress bars, on a terminal too
"""

from hybridsurrogate.notebook.bars import counted, filled, for_a_person
from hybridsurrogate.notebook.tables import table

__all__ = ["counted", "filled", "for_a_person", "table"]
