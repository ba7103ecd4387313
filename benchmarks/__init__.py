"""Benchmarks: the numbers of `docs/performance.md` are measured by `make bench`."""
