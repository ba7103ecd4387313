"""Fault campaigns: many trials of faults that the package must survive; `make faults` runs all, the tests a few."""
