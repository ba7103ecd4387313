"""The closed loop without middleware: one experiment, its compiled run, its metrics."""
