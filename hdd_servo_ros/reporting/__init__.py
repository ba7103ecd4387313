"""Reports of runs: summaries, verdicts, metrics, plots and HTML pages."""
