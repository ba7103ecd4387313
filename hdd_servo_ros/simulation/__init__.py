"""The closed loop without middleware: one compiled kernel, the experiment around it, and the command `simulate`."""
