"""What signals and models show: metrics, stability margins, identified models."""
