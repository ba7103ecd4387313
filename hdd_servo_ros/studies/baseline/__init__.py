"""
The adaptive NN controller against the best PID controllers: a module for each figure or table, and their ``cases.py``.

The best PID depends on how much its steps may overshoot, so that there is one for each limit.
"""
