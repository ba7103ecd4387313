"""Seek, settle, follow: how fast each method brings the head to a target, and what friction does to its arrival."""
