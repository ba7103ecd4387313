"""Friction of chapter 2: one file a family, each vectorised over velocity and as a compiled step."""
