"""
Adaptive NN against the best PID controllers: one module per figure or table; ``cases.py`` has the shared runs.

The best PID depends on the limit of the overshoot of steps, so there is one for each limit.
"""
