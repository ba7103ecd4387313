"""Assertions about recorded runs, and a pytest plugin that makes runs; see ``docs/bag-assertions.md``."""
