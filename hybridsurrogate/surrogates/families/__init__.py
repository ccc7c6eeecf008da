"""Families of surrogates: one file each, which registers an instance."""
