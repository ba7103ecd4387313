"""Many runs from one specification: what to run, who runs it, and what was recorded."""
