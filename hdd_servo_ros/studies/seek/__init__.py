"""Seek, settle, follow: access times of each method, and effect of friction on arrival."""
