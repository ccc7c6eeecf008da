"""The case studies of arXiv:2412.11875 and its claims: `python -m examples.studies.reproduction`."""
