"""
Simulation study of section 4.4: one module per figure or table; ``cases.py`` has the shared runs.

To add a figure, add a module ``fig_*.py`` or ``table_*.py`` with ``CASES`` and ``make``; see
:class:`~hdd_servo_ros.studies.chapter.Figure`.
"""
