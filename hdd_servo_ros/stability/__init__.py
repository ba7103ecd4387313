"""Theorem 4.1 of the thesis, checked against a known drive and against recorded runs."""
