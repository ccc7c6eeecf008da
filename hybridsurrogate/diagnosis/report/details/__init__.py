"""The folded parts of a report, one file a section.

extended_model, evidence (for the cause), place (where the simulation is wrong, and in which
outputs), gain (and the weight of the simulation), measurement (what to measure next), checks (of
the computation, and cautions), provenance (how it was computed), pictures.
"""
