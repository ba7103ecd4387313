"""Campaigns of faults: what the package must bear, tried many times; `make faults` runs them, tests a short part."""
