"""Families of surrogates: each registers an instance."""
