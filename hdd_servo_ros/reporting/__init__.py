"""What a run shows a person: a summary in words, and pictures."""
