"""Theorem 4.1 of the thesis, held against a known drive and against recorded runs."""
