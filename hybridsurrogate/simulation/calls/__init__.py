"""Calls of the function behind a simulation.

function      Function: what is called, with which arguments, and what it must return
jobs          calls that are timed, limited, and shared by processes
rows          one call a row, quickly
arrays        one call for all rows; rows that fail, and functions that take numbers only
output_cache  outputs of rows that were computed before
"""
