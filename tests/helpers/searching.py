"""A search over causes, with those that explain most given a process."""

from hybridsurrogate.diagnosis.search.context import SearchContext
from hybridsurrogate.diagnosis.search.processes import with_processes
from hybridsurrogate.diagnosis.search.search import search


def compared(problem, causes, emulator):
    return with_processes(search(SearchContext.of(problem, emulator), causes))
