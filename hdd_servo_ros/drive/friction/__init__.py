"""Friction of chapter 2: one file a family, each vectorized over velocity and as a compiled step."""
