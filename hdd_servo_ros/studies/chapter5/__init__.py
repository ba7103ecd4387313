"""
The experiments of chapter 5 on the bench's drive: one module a figure or table, ``cases.py`` what several run.

The thesis's figures are lost, its text alone says what they show; the drive's friction is calibrated after that text.
"""
