"""
Experiments of chapter 5 on the default drive: one module per figure or table; ``cases.py`` has the shared runs.

The figures of the thesis are lost; only its text describes them. The friction of the drive is calibrated to that text.
"""
